//! Safe values in virtual time: requests and their order while responses are late, invalid or missing.

use super::*;

fn lamps() -> [ChannelRow<'static>; 4] {
    let row = |name, address: &str| (name, DigitalOutput, address.into(), safe(0.0), None);
    [
        row("a", "coil 0"),
        row("b", "coil 2"),
        row("c", "coil 4"),
        row("d", "coil 6"),
    ]
}

/// Returns the requests until the time-out, without any response, and the fault at the end.
fn unanswered(bench: &mut ServerFixture) -> (Vec<Vec<u8>>, ServerFault) {
    let mut requests = Vec::new();
    loop {
        match bench.request() {
            Ok(Some(request)) => requests.push(request),
            Ok(None) => {
                bench.now = bench.server.wake(bench.now).expect("it waits for answers");
            }
            Err(fault) => return (requests, fault),
        }
    }
}

#[test]
fn safe_values_overtake_a_request_that_is_not_answered() {
    let mut bench = ServerFixture::new(json!({"timeout": "100 ms"}), &lamps());
    let begun = bench.now;
    let mut requests = Vec::new();
    for place in 0..4 {
        assert_eq!(bench.now, begun + 25 * MS * place);
        requests.push(bench.request().unwrap().expect("the next one"));
        bench.now = bench.server.wake(bench.now).unwrap();
    }
    // The last request has its whole time-out, and late responses count.
    assert_eq!(bench.now, begun + 175 * MS);
    assert!(!bench.server.is_idle());
    for request in [3, 0, 2, 1].map(|place| requests[place].clone()) {
        let answer = bench.device.answer(&request);
        bench.receive(&answer).unwrap();
    }
    bench.now -= MS;
    bench.run().unwrap();
    assert!(bench.server.is_idle());
    assert_eq!(bench.device.asked, [(5, 6), (5, 0), (5, 4), (5, 2)]);
}

#[test]
fn each_sweep_of_safe_values_begins_at_another_output() {
    let mut bench = ServerFixture::new(json!({"timeout": "100 ms"}), &lamps());
    let mut firsts = Vec::new();
    for _ in 0..4 {
        let (requests, fault) = unanswered(&mut bench);
        assert!(matches!(fault, ServerFault::Timeout { .. }), "{fault}");
        let mut addresses: Vec<u8> = requests.iter().map(|request| request[9]).collect();
        firsts.push(addresses[0]);
        addresses.sort_unstable();
        assert_eq!(addresses, [0, 2, 4, 6]);
        assert!(bench.server.is_released());
        bench.server.connected(bench.now);
    }
    firsts.sort_unstable();
    assert_eq!(firsts, [0, 2, 4, 6]);
}

#[test]
fn unconfirmed_values_are_sent_first_on_a_new_connection() {
    let mut bench = ServerFixture::new(json!({"timeout": "100 ms"}), &lamps());
    for (address, done) in [(0, false), (4, false), (6, false), (2, true)] {
        // The first is confirmed; the second is lost with its connection.
        let request = bench.request().unwrap().unwrap();
        assert_eq!(request[9], address);
        let answer = bench.device.answer(&request);
        bench.receive(&answer).unwrap();
        bench.request().unwrap().expect("the second");
        assert_eq!(bench.server.has_unsent_safe_values(), !done);
        bench.server.connected(bench.now);
    }
}

#[test]
fn bits_whose_register_is_not_answered_are_written_as_it_was_read_last() {
    let rows = [
        (
            "low",
            DigitalOutput,
            "holding 7 bit 0".into(),
            safe(0.0),
            None,
        ),
        ("other", DigitalOutput, "coil 0".into(), safe(0.0), None),
    ];
    let settings = json!({"mask_write": false, "timeout": "100 ms"});
    let mut bench = ServerFixture::new(settings, &rows);
    bench.device.registers[0][7] = 0x0FF0;
    bench.round(&outputs(0b11, 0b11, &[])).unwrap();
    assert_eq!(bench.device.registers[0][7], 0x0FF1);
    bench.server.prepare(bench.now);
    let (requests, _) = unanswered(&mut bench);
    for request in &requests {
        bench.device.answer(request);
    }
    assert_eq!(bench.device.registers[0][7], 0x0FF0);
    assert!(!bench.device.bits[0][0]);
}

#[test]
fn nonsense_for_an_answer_keeps_no_safe_value_from_being_sent() {
    let mut bench = ServerFixture::new(json!({"timeout": "100 ms"}), &lamps());
    let request = bench.request().unwrap().unwrap();
    let mut nonsense = bench.device.answer(&request);
    nonsense[2] = 0x55;
    bench.receive(&nonsense).unwrap();
    let (requests, fault) = unanswered(&mut bench);
    assert_eq!(requests.len(), 3);
    assert!(matches!(fault, ServerFault::Broken(_)), "{fault}");
}

#[test]
fn a_busy_server_gets_the_other_safe_values_first() {
    let mut bench = ServerFixture::new(json!({"timeout": "100 ms"}), &lamps());
    bench.device.refuses.push((5, 0, 6));
    for _ in 0..4 {
        let request = bench.request().unwrap().unwrap();
        let answer = bench.device.answer(&request);
        bench.receive(&answer).unwrap();
    }
    assert_eq!(bench.device.asked, [(5, 0), (5, 2), (5, 4), (5, 6)]);
    bench.device.refuses.clear();
    bench.run().unwrap();
    bench.now += 5 * MS;
    bench.run().unwrap();
    assert_eq!(bench.device.asked.last(), Some(&(5, 0)));
    assert!(bench.server.is_idle());
}
