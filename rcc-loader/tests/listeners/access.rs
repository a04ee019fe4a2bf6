//! Access to a listener: the token of TCP, and the group of the socket.

use super::*;

#[test]
fn tcp_requires_the_token() {
    let test = TestCell::new("token");
    let served = TestServer::with(&test.cell, &tcp(&test.cell));
    let address = served.address.unwrap();
    let almost = format!("authorization: Bearer {}0\r\n", &TOKEN[1..]);
    let basic = format!("authorization: Basic {TOKEN}\r\n");
    for lines in ["", "authorization: Bearer \r\n", &almost, &basic] {
        let (status, body) = exchange(connect_from(1, address), &get("/primitives", lines));
        assert_eq!((status, &body["code"]), (401, &"RCC4015".into()), "{lines}");
        assert!(
            body["help"].as_str().unwrap().contains("RCC_TOKEN"),
            "{body}"
        );
    }
    wait_for_log(&served, "RCC4015");
    assert_eq!(
        exchange(connect_from(1, address), &get("/primitives", &with_token())).0,
        200
    );
    assert!(!served.log().contains(TOKEN));
}

#[test]
fn wrong_tokens_take_nothing_from_the_holder_of_the_right_one_at_the_same_address() {
    let test = TestCell::new("lock-out");
    let served = TestServer::with(&test.cell, &tcp(&test.cell));
    let address = served.address.unwrap();
    let wrong = get("/primitives", "authorization: Bearer wrong\r\n");
    let mut refused = [0, 0];
    for _ in 0..3 * TCP.burst {
        match exchange(connect_from(1, address), &wrong).0 {
            401 => refused[0] += 1,
            // Closed with an error, or at once.
            _ => refused[1] += 1,
        }
    }
    assert!(
        refused[0] >= UNAUTHENTICATED.1 && refused[1] > 0,
        "{refused:?}"
    );
    // Connections that never send a head do not take the holder's slot either.
    let _silent: Vec<_> = (0..HEADS_MAX + 8)
        .map(|_| connect_from(1, address))
        .collect();
    for _ in 0..60 {
        let right = get("/nothing", &with_token());
        assert_eq!(exchange(connect_from(1, address), &right).0, 404);
    }
}

#[test]
fn a_body_is_not_read_before_the_token_was_seen() {
    let test = TestCell::new("first");
    let served = TestServer::with(&test.cell, &tcp(&test.cell));
    let mut stream = connect_from(1, served.address.unwrap());
    stream
        .write_all(b"POST /commands HTTP/1.1\r\nhost: x\r\ncontent-length: 4000000\r\n\r\n")
        .unwrap();
    assert_eq!(answer(stream).0, 401);
}

#[test]
fn a_configured_group_may_use_the_socket_and_otherwise_only_its_user() {
    let test = TestCell::new("group");
    let modes = || {
        let mode = |path: &std::path::Path| fs::metadata(path).unwrap().mode() & 0o777;
        (mode(test.cell.runtime_dir()), mode(&test.cell.socket()))
    };
    let own = nix::unistd::Group::from_gid(nix::unistd::getgid())
        .unwrap()
        .unwrap();
    let access = AccessConfig {
        group: Some(own.name),
        tcp: None,
    };
    drop(Listeners::open(&test.cell, &access).unwrap());
    assert_eq!(modes(), (0o750, 0o660));
    // A process that joins the cell later leaves the modes unchanged; the contents remain private.
    assert!(Cell::at("group", test.cell.runtime_dir()).is_ok());
    assert_eq!(modes().0, 0o750);
    assert_eq!(
        fs::metadata(test.cell.processes_dir()).unwrap().mode() & 0o777,
        0o700
    );
    drop(Listeners::open(&test.cell, &AccessConfig::default()).unwrap());
    assert_eq!(modes(), (0o700, 0o600));
}

#[test]
fn a_listener_without_valid_access_control_is_not_opened() {
    let test = TestCell::new("locked");
    let access = AccessConfig {
        group: Some("no-such-group".to_owned()),
        tcp: None,
    };
    let refused = Listeners::open(&test.cell, &access).unwrap_err();
    assert!(matches!(refused, ListenError::NoGroup { .. }) && refused.is_final());
    let access = tcp(&test.cell);
    fs::write(&access.tcp.as_ref().unwrap().token_file, "secret").unwrap();
    let refused = Listeners::open(&test.cell, &access).unwrap_err();
    assert!(matches!(refused, ListenError::Token(_)) && refused.is_final());
    assert!(refused.to_string().contains("openssl rand"), "{refused}");
    assert!(!test.cell.socket().exists());
}
