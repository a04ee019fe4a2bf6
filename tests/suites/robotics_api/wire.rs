//! Contents and order of the bytes on the wire: upgrade, frames, messages, answers, pushes.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::Duration;

use serde_json::Value;

use super::client::{Client, Connection, Heard, post, quoted, text_of};
use super::gateway::GatewayFixture;
use super::nets::{AT_ONCE, IDLE, guarded, values};

fn texts(heard: &[Heard]) -> Vec<&str> {
    heard.iter().map(|heard| heard.text.as_str()).collect()
}

#[test]
fn connections_requests_and_pushes_are_as_the_library_needs_them() {
    let gateway = GatewayFixture::own(&[]);
    let port = gateway.port;
    nothing_comes_before_the_handshake(port);
    pings_are_answered_and_a_close_too(port);
    a_strange_key_is_refused(port);
    every_request_has_one_answer(port);
    nets_and_rules_have_their_states(port);
    results_never_overtake_the_rule(port);
    values_go_in_and_come_out(port);
    evaluations_need_no_connection(port);
    a_guard_is_judged_by_the_core_in_every_cycle(&gateway);
    gateway.stop();
}

fn nothing_comes_before_the_handshake(port: u16) {
    let mut connection = Connection::upgrade(port);
    for request in ["nse(\"a@b\")", "gde()", "ver(\"1.0\")", "ver()"] {
        assert_eq!(
            connection.request(request),
            "err(\"bad handshake\")",
            "{request}"
        );
    }
    assert_eq!(connection.request("ver(\"2.0\")"), "ok(\"handshake ok\")");
    connection.send_frame(1, "this is no message");
    assert!(
        connection
            .hear("none", |text| text.starts_with("none=err("))
            .text
            .contains("invalid syntax")
    );
}

fn pings_are_answered_and_a_close_too(port: u16) {
    let mut connection = Connection::open(port);
    connection.send_frame(9, "p0");
    assert_eq!(connection.hear("a pong", |text| text == "p0").opcode, 10);
    connection.send_frame(8, "BYE");
    connection.await_end();
    assert_eq!(connection.log.last().map(|heard| heard.opcode), Some(8));
}

fn a_strange_key_is_refused(port: u16) {
    let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).expect("it listens");
    let head = "GET /DirectIO/ HTTP/1.1\r\nUpgrade: websocket\r\nSec-WebSocket-Key: AAAA\r\n\r\n";
    stream.write_all(head.as_bytes()).expect("a request");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    assert!(answer.starts_with("HTTP/1.1 400 "), "{answer}");
}

fn every_request_has_one_answer(port: u16) {
    let mut client = Client::connect(port);
    for request in [
        "gne(\"rpinet999\",0.02)",
        "gne()",
        "gsy(\"999\")",
        "gsy(\"x\")",
        "neun(\"REJECTED\")",
        "neca(\"x\")",
        "neab(\"x\")",
        "nest(\"x\")",
        "nesc(\"REJECTED.out\",[],[],[])",
        "nesc(\"t\",[],[],[\"x\"])",
        "nesc(\"t &\",[],[],[])",
        "nesc(\"t\",[])",
        "nesc()",
        "snc({x:{in_1:\"1\"}})",
        "snc()",
        "ase(\"s999\")",
        "xyz()",
    ] {
        let answer = client.control.request(request);
        assert!(
            answer.starts_with("err(\"") && answer.len() > 8,
            "{request}: {answer}"
        );
    }
    for net in ["{1=", "{}", "{1=Core::Nothing(),outTerminate=1.outValue}"] {
        let answer = client.load_any(net);
        assert!(answer.starts_with("err(\""), "{net}: {answer}");
    }
    // Pipelined requests: each has its own answer, whatever their order.
    let tags: Vec<String> = (0..50).map(|_| client.control.ask("neca(\"x\")")).collect();
    for tag in &tags {
        assert!(client.control.answer(tag).starts_with("err("));
    }
    client.control.listen();
    let answers = client
        .control
        .log
        .iter()
        .filter(|heard| heard.text.starts_with(&format!("{}=", tags[0])));
    assert_eq!(answers.count(), 1);
    // A net of 105 kB has a length of 64 bits.
    let padding = format!("9=Core::BooleanValue(Value='{}'),", " ".repeat(105_000));
    let answer = client.load_any(&AT_ONCE.replacen('{', &format!("{{{padding}"), 1));
    assert!(
        answer.starts_with("err("),
        "blanks are no boolean value: {answer}"
    );
}

fn nets_and_rules_have_their_states(port: u16) {
    let mut client = Client::connect(port);
    let net = client.load(IDLE);
    assert_eq!(texts(&client.data.with_tag(&net.tag))[1], "ns(\"READY\")");
    let name = net.name.as_str();
    let cancel = client.rule(&format!("{name}.out_c"), [&[name], &[], &[]]);
    let never = client.rule(
        &format!("{name}.out_go & !{name}.out_go"),
        [&[], &[name], &[]],
    );
    client.data.push(&cancel, "rs(\"ACTIVE\")");
    let start = client.rule("t", [&[], &[], &[name]]);
    client.data.push(&start, "rs(\"FIRED\")");
    client.data.push(&net.tag, "ns(\"RUNNING\")");
    let first = client.data.push(&net.tag, "nc(");
    for value in ["out_c:\"false\"", "out_go:\"false\"", "out_x:\""] {
        assert!(first.text.contains(value), "{}", first.text);
    }
    assert!(
        client
            .control
            .request(&format!("neun(\"{name}\")"))
            .starts_with("err("),
        "it runs"
    );
    // The application cancels as the library does.
    client.rule("t", [&[], &[name], &[]]);
    client.data.push(&cancel, "rs(\"FIRED\")");
    let all = client.await_end(&net);
    let all = texts(&all);
    assert_eq!(all.last(), Some(&"ns(\"TERMINATED\")"), "{all:?}");
    let last = all[all.len() - 2];
    assert!(
        last.starts_with("nc({") && last.contains("out_c:\"true\""),
        "{all:?}"
    );
    client.data.push(&never, "rs(\"INACTIVE\")");
    // Values and state of a net that ended can be read again, and rules on them fire at once.
    let again = client.subscribe(name);
    let all = client.data.with_tag(&again.tag);
    assert!(texts(&all)[1].contains("out_c:\"true\""), "{all:?}");
    assert_eq!(texts(&all)[2], "ns(\"TERMINATED\")");
    let late = client.rule(&format!("{name}.out_c"), [&[], &[], &[]]);
    client.data.push(&late, "rs(\"FIRED\")");
    assert_eq!(client.control.request(&format!("neun(\"{name}\")")), "ok()");
    client.data.push(&net.tag, "ns(\"UNLOADED\")");
    assert_eq!(
        client.data.request(&format!("gne(\"{name}\",0.02)")),
        "err(\"invalid net\")"
    );
    // A net that a rule was to start may still be started otherwise; one that never ran can be stopped.
    let idle = client.load(IDLE);
    assert_eq!(
        client.control.request(&format!("neab(\"{}\")", idle.name)),
        "ok()"
    );
    client.data.push(&idle.tag, "ns(\"TERMINATED\")");
}

/// The races of the library (protocol, section 2.3), with a net that is completed in its first cycle.
fn results_never_overtake_the_rule(port: u16) {
    let mut client = Client::connect(port);
    for _ in 0..10 {
        let net = client.load(AT_ONCE);
        let name = net.name.as_str();
        client.rule(&format!("{name}.out_2"), [&[name], &[], &[]]);
        let answer = client.rule_any("t", [&[], &[], &[name]]);
        // The library subscribes to the rule only now, and may be slow.
        client.data.listen_for(Duration::from_millis(30));
        let start = client
            .data
            .ask(&format!("gsy({})", quoted(&text_of(&answer))));
        let all = client.await_end(&net);
        let fired = client.data.push(&start, "rs(\"FIRED\")");
        let pushes: Vec<&Heard> = all
            .iter()
            .filter(|heard| heard.text.starts_with('n'))
            .collect();
        for push in pushes.iter().skip_while(|heard| {
            heard.text != "ns(\"RUNNING\")" && !heard.text.contains("TERMINATED")
        }) {
            assert!(push.at > fired.at, "{push:?} overtook {fired:?}");
        }
        // One state in 10 ms at most, as the client saw them; values directly before the last state.
        let all = texts(&all);
        let end = all
            .iter()
            .position(|text| *text == "ns(\"TERMINATED\")")
            .expect("it ended");
        assert!(all[end - 1].contains("out_2:\"true\""), "{all:?}");
        if let Some(running) = all.iter().position(|text| *text == "ns(\"RUNNING\")") {
            assert!(
                running < end - 1 || all[end - 1].starts_with("nc("),
                "{all:?}"
            );
        }
        let before = &all[..end - 1];
        assert!(
            !before.iter().any(|text| text.contains("out_2:\"true\"")),
            "the result came alone: {all:?}"
        );
    }
    // A client that never subscribes to the rule is not waited for for ever.
    let net = client.load(AT_ONCE);
    let name = net.name.as_str();
    client.rule_any(&format!("{name}.out_2"), [&[name], &[], &[]]);
    client.rule_any("t", [&[], &[], &[name]]);
    client.await_end(&net);
}

fn values_go_in_and_come_out(port: u16) {
    let mut client = Client::connect(port);
    let net = client.load(IDLE);
    let name = net.name.as_str();
    // Before the net is started, as the library does with the override.
    assert_eq!(
        client
            .control
            .request(&format!("snc({{{name}:{{in_go:\"false\"}}}})")),
        "ok()"
    );
    let go = client.rule(&format!("{name}.out_go"), [&[name], &[], &[]]);
    client.rule("t", [&[], &[], &[name]]);
    client.data.push(&net.tag, "ns(\"RUNNING\")");
    for wrong in ["{in_go:\"7\"}", "{in_go:7}", "7"] {
        let answer = client.control.request(&format!("snc({{{name}:{wrong}}})"));
        assert!(answer.starts_with("err("), "{wrong}: {answer}");
    }
    // Values at the rate that was asked for: of three messages, the two gaps are 20 ms.
    let counts = |client: &Client| {
        let all = client.data.with_tag(&net.tag);
        all.iter()
            .filter(|heard| heard.text.contains("out_x"))
            .count()
    };
    while counts(&client) < 4 {
        let heard = client.data.log.len();
        let tag = net.tag.clone();
        client
            .data
            .hear("a value", |text| text.starts_with(&format!("{tag}=nc(")));
        client
            .data
            .listen_for(Duration::from_millis(if client.data.log.len() == heard {
                20
            } else {
                0
            }));
    }
    assert_eq!(
        client.control.request(&format!(
            "snc({{{name}:{{in_go:\"true\",in_other:\"1\"}}}})"
        )),
        "ok()"
    );
    client.data.push(&go, "rs(\"FIRED\")");
    let all = client.await_end(&net);
    assert!(
        texts(&all)[all.len() - 2].contains("out_go:\"true\""),
        "{all:?}"
    );
    let answer = client
        .control
        .request(&format!("snc({{{name}:{{in_go:\"true\"}}}})"));
    assert!(answer.contains("TERMINATED"), "{answer}");
}

fn evaluations_need_no_connection(port: u16) {
    let client = Client::connect(port);
    let net = "{a=World::FrameFromPosRot(X='0.5',Y='0.0',Z='0.25',A='0.1',B='-0.2',C='0.3'),\
        o=World::FrameNetcommOut(inValue=a.outValue,Key='frame'),n=Core::DoubleValue(Value='nan'),\
        p=Core::DoubleNetcommOut(inValue=n.outValue,Key='null'),b=Core::BooleanValue(Value='true'),\
        q=Core::BooleanNetcommOut(inValue=b.outValue,Key='b')}";
    let document = client.evaluate(net);
    assert!(
        document.starts_with("<?xml version=\"1.0\" encoding=\"UTF-8\"?><eval><data key=\"out"),
        "{document}"
    );
    let found = values(&document);
    assert_eq!(
        found
            .iter()
            .find(|(key, _)| key == "outb")
            .map(|(_, value)| value.as_str()),
        Some("true")
    );
    let frame = &found
        .iter()
        .find(|(key, _)| key == "outframe")
        .expect("a frame")
        .1;
    assert!(
        frame.starts_with("{pos:{x:0.5,y:0.0,z:0.25},rot:{a:0.1") && !frame.contains(' '),
        "{frame}"
    );
    assert!(
        !found.iter().any(|(key, _)| key == "outnull"),
        "null is not reported: {found:?}"
    );
    // A failure is a document, too: anything else is a NullPointerException in the library.
    for wrong in [
        "{1=",
        "{1=Core::Nothing()}",
        "{1=RobotArm::JointMonitor(Robot='nobody',Axis='0'),o=Core::DoubleNetcommOut(inValue=1.outMeasuredPosition,Key='r')}",
    ] {
        let document = client.evaluate(wrong);
        assert!(document.contains("<data key=\"error\">"), "{document}");
    }
    assert_eq!(post(port, "//devices/", "type=io").0, 400);
    assert_eq!(
        post(port, "//devices/", "name=g&type=schunk_wsg_sim").0,
        400
    );
    assert_eq!(post(port, "/nothing", "").0, 404);
}

/// A rule that cancels on a condition is a rule of the core: it does not miss what is true for one cycle.
fn a_guard_is_judged_by_the_core_in_every_cycle(gateway: &GatewayFixture) {
    let mut client = Client::connect(gateway.port);
    let net = client.load(&guarded());
    let name = net.name.as_str();
    let guard = client.rule(&format!("{name}.out_g"), [&[], &[name], &[]]);
    let rules = || {
        let all = gateway.place.rest("GET", "/rules", "").body;
        let of_net = |rule: &&Value| {
            rule["when"]
                .as_str()
                .is_some_and(|when| when.contains(name))
        };
        let found = all
            .as_array()
            .and_then(|all| all.iter().find(of_net).cloned());
        found.map(|rule| rule["state"].clone())
    };
    assert_eq!(rules(), Some("armed".into()));
    client.rule(&format!("{name}.out_c"), [&[name], &[], &[]]);
    client.rule("t", [&[], &[], &[name]]);
    client.data.push(&guard, "rs(\"FIRED\")");
    assert_eq!(rules(), Some("fired".into()));
    client.await_end(&net);
}
