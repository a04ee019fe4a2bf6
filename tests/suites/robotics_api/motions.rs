//! Devices that a client creates, and nets that the library sent for real motions, on the gateway's simulated devices.

use super::client::{Client, LoadedNet, post};
use super::gateway::GatewayFixture;
use super::nets::{flange, joint_positions, output, recorded, values};

/// Goal of the recorded point-to-point motion, rad; it begins where all joints are 0.
const AFTER_PTP: [f64; 7] = [0.3, 0.4, 0.0, -1.4, 0.0, 1.1, 0.0];

fn positions(client: &Client, device: &str, joints: usize) -> Vec<f64> {
    let found = values(&client.evaluate(&joint_positions(device, joints)));
    let found: Vec<f64> = found
        .iter()
        .filter_map(|(_, value)| value.parse().ok())
        .collect();
    assert_eq!(found.len(), joints, "{found:?}");
    found
}

fn assert_near(found: &[f64], expected: &[f64]) {
    let far = found
        .iter()
        .zip(expected)
        .any(|(found, expected)| (found - expected).abs() > 1e-6);
    assert!(!far, "{found:?}, expected {expected:?}");
}

fn run(client: &mut Client, file: &str) -> LoadedNet {
    let net = client.load(&recorded(file));
    let fired = client.start(&net, &["out_1", "out_2"]);
    client.data.push(&fired, "rs(\"FIRED\")");
    assert_completed(client, &net);
    net
}

fn assert_completed(client: &mut Client, net: &LoadedNet) {
    let all = client.await_end(net);
    let texts: Vec<&str> = all.iter().map(|heard| heard.text.as_str()).collect();
    assert_eq!(texts.last(), Some(&"ns(\"TERMINATED\")"), "{texts:?}");
    assert!(
        texts[texts.len() - 2].contains("out_2:\"true\""),
        "{texts:?}"
    );
}

#[test]
fn an_arm_and_channels_are_created_and_driven() {
    let gateway = GatewayFixture::own(&[]);
    let mut client = Client::connect(gateway.port);
    client.create("lwr", "type=kuka_lwr_sim&tcp={pos:{x:0},rot:{a:0}}&mass=0");
    let begin = format!(
        "{}=da({{lwr:{{type:\"kuka_lwr_sim\",interfaces:{{robotarm:{{jointcount:\"7\"}}",
        client.devices
    );
    client
        .data
        .hear("the interfaces", |text| text.starts_with(&begin));
    assert_eq!(
        post(gateway.port, "//devices/", "name=lwr&type=kuka_lwr_sim").0,
        400,
        "it exists"
    );
    assert_near(&positions(&client, "lwr", 7), &[0.0; 7]);

    // Point to point, then a straight line from there; between them the application asks where the arm is.
    run(&mut client, "flat/lwr_lin-01-lwr-ptp.net");
    assert_near(&positions(&client, "lwr", 7), &AFTER_PTP);
    run(&mut client, "flat/lwr_lin-02-lwr-lin.net");
    let after_line = positions(&client, "lwr", 7);
    assert!(
        after_line
            .iter()
            .zip(AFTER_PTP)
            .any(|(found, before)| (found - before).abs() > 0.01),
        "{after_line:?}"
    );

    // No device can be created while a net runs.
    let net = client.load(super::nets::IDLE);
    let name = net.name.as_str();
    client.rule(&format!("{name}.out_c"), [&[name], &[], &[]]);
    client.rule("t", [&[], &[], &[name]]);
    client.data.push(&net.tag, "ns(\"RUNNING\")");
    let (status, reason) = post(gateway.port, "//devices/", "name=io0&type=io");
    assert!(status == 409 && reason.contains(name), "{status} {reason}");
    assert_eq!(client.control.request(&format!("neca(\"{name}\")")), "ok()");
    client.await_end(&net);

    // A second device: the cell is started again; an output is wired to the input of its number.
    client.create("io0", "type=io");
    for value in [true, false] {
        let net = client.load(&output("io0", 3, value));
        client.start(&net, &["out_2"]);
        assert_completed(&mut client, &net);
        let input = "{1=IO::InBool(DeviceID='io0',Port='3'),2=Core::BooleanNetcommOut(inValue=1.outIO,Key='i')}";
        let expected = [("outi".to_owned(), value.to_string())];
        rcc_tests::await_some("the input to follow the output", || {
            (values(&client.evaluate(input)) == expected).then_some(())
        });
    }
    let refused = client.evaluate(&output("io0", 3, true).replace(",outTerminate=3.outValue", ""));
    assert!(refused.contains("must not command"), "{refused}");

    assert_eq!(
        post(gateway.port, "//devices/", "name=io0&action=remove").0,
        303
    );
    let gone = format!("{}=dr([\"io0\"])", client.devices);
    client
        .data
        .hear("the device to be removed", |text| text == gone);
    assert_eq!(
        post(gateway.port, "//devices/", "name=io0&action=remove").0,
        404
    );
    gateway.stop();
}

#[test]
fn a_motion_is_canceled_on_its_way_and_another_follows_it() {
    let gateway = GatewayFixture::own(&[]);
    let mut client = Client::connect(gateway.port);
    client.create("lwr", "type=kuka_lwr_sim");

    // Both are loaded before the first one begins, as queued motions are. The second one was prepared for another place: it
    // takes over when the first one has ended.
    let first = client.load(&recorded("flat/lwr_lin-01-lwr-ptp.net"));
    let second = client.load(&recorded("flat/lwr_lin-02-lwr-lin.net"));
    client.start(&first, &["out_1", "out_2"]);
    let (before, after) = (first.name.as_str(), second.name.as_str());
    client.rule(&format!("{after}.out_1"), [&[after], &[], &[]]);
    client.rule(&format!("{after}.out_2"), [&[after], &[], &[]]);
    let follows = client.rule(&format!("{before}.out_2"), [&[before], &[], &[after]]);
    client.data.push(&second.tag, "ns(\"SCHEDULED\")");
    client.data.push(&follows, "rs(\"FIRED\")");
    assert_completed(&mut client, &first);
    assert_completed(&mut client, &second);

    // Canceled while it runs: the arm brakes on its path, the net reports its cancel result and is stopped.
    client.create("iiwa", "type=kuka_iiwa_sim");
    let net = client.load(&recorded("flat/iiwa_lin-01-iiwa-ptp.net"));
    let name = net.name.as_str();
    client.start(&net, &["out_1", "out_2", "out_3"]);
    client.data.push(&net.tag, "ns(\"RUNNING\")");
    client.rule("t", [&[], &[name], &[]]);
    client.data.push(&net.tag, "ns(\"CANCELLING\")");
    let all = client.await_end(&net);
    let last = &all[all.len() - 2].text;
    // Its result "canceled".
    assert!(last.contains("out_3:\"true\""), "{last}");
    let stopped = positions(&client, "iiwa", 7);
    assert!(
        stopped.iter().any(|position| position.abs() > 1e-9),
        "{stopped:?}"
    );

    // A net for an arm that is not where it begins is refused by the core's own checks: the rule fails, nothing moves.
    let net = client.load(&recorded("flat/iiwa_lin-01-iiwa-ptp.net"));
    let failed = client.rule("t", [&[], &[], &[net.name.as_str()]]);
    client.data.push(&failed, "rs(\"FIREFAILED\")");
    assert_near(&positions(&client, "iiwa", 7), &stopped);
    gateway.stop();
}

/// Rows of an arm as the KR 6 R700 sixx in standard form.
const KR: &str = "type=kuka_kr_arm_sim&dh_d=[0.4,0,0,-0.365,0,-0.08]&dh_a=[0.025,0.315,0.035,0,0,0]&dh_t=[0,0,-1.5707963267948966,0,0,0]\
    &dh_al=[1.5707963267948966,0,1.5707963267948966,-1.5707963267948966,1.5707963267948966,3.141592653589793]\
    &min_joint=[-2.9,-3.3,-2.0,-3.2,-2.0,-6.1]&max_joint=[2.9,0.7,2.7,3.2,2.0,6.1]&home_joint=[0,-1.5,1.5,0,0.5,0]";

#[test]
fn an_arm_of_denavit_and_hartenbergs_rows_is_recognised_or_taken_by_its_axes() {
    let gateway = GatewayFixture::own(&[]);
    let mut client = Client::connect(gateway.port);
    let (status, reason) = post(
        gateway.port,
        "//devices/",
        &format!("name=odd&{}", KR.replace("0.315", "0.315,0")),
    );
    assert!(
        status == 400 && reason.contains("dh_a"),
        "{status} {reason}"
    );
    let skewed = KR.replace("dh_al=[1.57", "dh_al=[1.27");
    client.create("odd", &skewed);
    assert_near(
        &positions(&client, "odd", 6),
        &[0.0, -1.5, 1.5, 0.0, 0.5, 0.0],
    );
    client.create("kr", KR);
    assert_near(
        &positions(&client, "kr", 6),
        &[0.0, -1.5, 1.5, 0.0, 0.5, 0.0],
    );
    // The product of the six matrices by hand: x = 0.482489 m, z = 0.089143 m.
    let found = values(&client.evaluate(&flange("kr", 6)));
    let x = "x:0.48248882347655";
    assert!(
        found[0].1.contains(x) && found[0].1.contains("z:0.0891431223080"),
        "{found:?}"
    );
    gateway.stop();
}
