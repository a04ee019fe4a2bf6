//! Tests of streams without an executor. Run by the test harness.

use super::*;
use crate::server::live;
use crate::server::peer::ClientPeer;
use crate::server::quota::{Quota, QuotaLimits};
use http_body_util::BodyExt;
use rcc_api::streams::StreamValues;

fn request(ports: &[&str], rate: f64) -> StreamRequest {
    StreamRequest {
        ports: ports.iter().map(|port| (*port).to_owned()).collect(),
        rate,
        ..StreamRequest::default()
    }
}

#[test]
fn ports_are_sorted_by_net_and_fragments_stay_in_the_pattern() {
    let ports = ["belt/soft.out", "line#7/a/filter.out[1]", "belt/speed.*"];
    let found = subscriptions(&request(&ports, 1000.0), 1000.0).map(|found| {
        let rows = found.into_iter().map(|one| (one.net, one.patterns));
        rows.collect::<Vec<_>>()
    });
    let belt = ["soft.out", "speed.*"].map(str::to_owned).to_vec();
    let line = vec!["a/filter.out[1]".to_owned()];
    assert_eq!(
        found,
        Ok(vec![("belt".to_owned(), belt), ("line#7".to_owned(), line)])
    );
}

#[test]
fn a_stream_without_subject_net_or_possible_rate_is_refused() {
    let many: Vec<String> = (0..=STREAM_NETS_MAX)
        .map(|net| format!("n{net}/a.b"))
        .collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    for (ports, rate) in [
        (&[][..], 10.0),
        (&["soft.out"], 10.0),
        (&["belt/soft.out"], 0.0),
        (&["belt/soft.out"], 1000.1),
        (&["belt/soft.out"], f64::NAN),
        (&many, 10.0),
    ] {
        let refused = subscriptions(&request(ports, rate), 1000.0).map(|_| ());
        assert_eq!(
            refused.map_err(|error| error.code),
            Err(codes::BAD_REQUEST),
            "{ports:?}"
        );
    }
}

#[test]
fn states_and_monitors_are_looked_at_as_often_as_the_rate_says() {
    let every = |states: bool, monitors: &[&str], rate: f64| {
        let request = StreamRequest {
            states,
            monitors: monitors.iter().map(|port| (*port).to_owned()).collect(),
            ..request(&["belt/soft.out"], rate)
        };
        look_every(&request).as_millis()
    };
    assert_eq!(every(true, &[], 10.0), 4, "a client waits for a state");
    assert_eq!(every(true, &["*"], 10.0), 20, "at least 50 times a second");
    assert_eq!(every(true, &["*"], 100.0), 10);
    assert_eq!(every(false, &["*"], 250.0), 4);
    assert_eq!(every(false, &["*"], 1000.0), 4, "at most 250 times");
    assert_eq!(every(false, &[], 1000.0), 20, "ports have their own rate");
}

#[test]
fn a_slow_reader_is_told_how_much_it_lost_before_it_sees_more() {
    let limits = QuotaLimits {
        all: 1,
        of_peer: 1,
        reserve: 0,
        small: 0,
    };
    let place = Quota::new(limits).take(ClientPeer::Process(1), 1);
    let (client, response) = live::answer("text/event-stream", place.expect("a place"));
    let mut stream = EventStream {
        subscriptions: Vec::new(),
        incarnation: 0,
        period: Duration::from_millis(10),
        look_every: LOOK_EVERY,
        port: None,
        states: None,
        reader: None,
        monitors: None,
        waiting: VecDeque::new(),
        loss: StreamLoss::default(),
        spoke: Instant::now(),
    };
    let mut send = |id| {
        let values = StreamValues {
            id,
            ..StreamValues::default()
        };
        let is_sent = stream.send(&client, "values", &values);
        stream.loss.samples += u64::from(!is_sent);
        is_sent
    };
    assert_eq!((0..1000).filter(|id| send(*id)).count(), live::PIECES_MAX);
    let runtime = tokio::runtime::Builder::new_current_thread().build();
    let runtime = runtime.expect("a runtime");
    let mut body = response.into_body();
    let mut take = || {
        let frame = runtime
            .block_on(body.frame())
            .expect("open")
            .expect("a piece");
        let bytes = frame.into_data().unwrap_or_default();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    (0..live::PIECES_MAX).for_each(|_| assert!(take().starts_with("event: values\n")));
    assert!(send(1000), "there is room again");
    let lost = 1000 - live::PIECES_MAX;
    let told = format!("event: lost\ndata: {{\"samples\":{lost},\"events\":0,\"records\":0}}\n\n");
    assert_eq!(take(), told);
    assert!(take().contains("\"id\":1000"));
}

#[test]
fn only_ports_of_commands_that_are_named_by_their_id_can_be_over() {
    let ports = ["#7/a.b", "7/a.c", "line#8/a.b", "line/a.b"];
    let found = subscriptions(&request(&ports, 10.0), 1000.0).map(|found| {
        let ids = found.iter().map(Subscription::id);
        ids.collect::<Vec<_>>()
    });
    assert_eq!(found, Ok(vec![Some(7), Some(7), Some(8), None]));
}
