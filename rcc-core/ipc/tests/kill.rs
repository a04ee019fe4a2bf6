//! Processes killed at any moment leave nothing behind and use up no resources of live processes. Run by the test
//! program's threads and by child processes of it.

mod common;

use std::fs;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use common::{
    LIMIT, Peer, TestCell, part, paths_below, refused, run_janitor, wait_for, wait_until_started,
};
use rcc_ipc::{Cell, Session, board, request, stream};
use rcc_protocol::Role;
use rcc_testing::Rng;

/// The child process: works until it is killed.
#[test]
fn peer() {
    let Some((part, cell, label)) = part() else {
        return;
    };
    if part == "busy" {
        // Every kind of service, repeatedly, so that a kill can hit any moment.
        loop {
            let session = Session::join(&cell, Role::Driver, &label).unwrap();
            fs::write(cell.runtime_dir().join("started"), "").unwrap();
            let mut board = session.create_board::<[u64; 64]>("board").unwrap();
            let server = session.serve("server").unwrap();
            let mut publisher = session.publisher::<[u64; 8]>("stream").unwrap();
            let reader = session.open_board::<[u64; 64]>(board.service()).unwrap();
            let mut subscriber = session.subscribe::<[u64; 8]>(publisher.service()).unwrap();
            let client = session.client(server.service()).unwrap();
            board.write(&[1; 64]);
            assert_eq!(reader.read(), [1; 64]);
            publisher.publish(&[[2; 8]; 100]).unwrap();
            assert!(subscriber.next_batch().unwrap().is_some());
            refused(client.call(&[0; 50_000], Duration::ZERO));
        }
    }
    if part == "guest" {
        // Uses everything that a live process offers, repeatedly, so that a kill can hit any moment.
        let host = cell.announced(Role::Executor, "exec").unwrap().unwrap();
        loop {
            let session = Session::join(&cell, Role::Cli, &label).unwrap();
            fs::write(cell.runtime_dir().join("started"), "").unwrap();
            let reader = session.open_board::<u64>(&host.services["board"]).unwrap();
            let mut subscriber = session
                .subscribe::<[u64; 8]>(&host.services["stream"])
                .unwrap();
            let client = session.client(&host.services["server"]).unwrap();
            let answer = client
                .call(&vec![3; (reader.read() % 50_000) as usize], LIMIT)
                .unwrap();
            assert!(!answer.is_empty());
            subscriber.next_batch().unwrap();
        }
    }
    unreachable!("no part {part}");
}

/// The same moments in each run, spread over everything that a process does in its first 20 ms.
fn random_delays_us(count: usize) -> impl Iterator<Item = u64> {
    let seed = std::env::var("RCC_IPC_TEST_SEED").ok();
    let seed = seed.and_then(|t| t.parse().ok()).unwrap_or(1);
    let mut random = Rng::with_seed(seed);
    std::iter::repeat_with(move || random.u64(..20_000)).take(count)
}

#[test]
fn a_process_killed_at_any_moment_leaves_nothing_after_the_janitor() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut own = session.create_board::<u64>("own").unwrap();
    run_janitor(&cell).unwrap();
    let before = cell.files();
    let before_on_disk = paths_below(&cell.iox_root());
    for (round, delay_us) in random_delays_us(40).enumerate() {
        let round = round as u64;
        let peer = Peer::start(&cell, "busy", "lwr");
        fs::remove_file(wait_until_started(&cell)).unwrap();
        std::thread::sleep(Duration::from_micros(delay_us));
        peer.kill();
        // Files created just before the kill that are still empty are left for a later run.
        wait_for(|| {
            run_janitor(&cell).unwrap();
            (cell.files() == before && paths_below(&cell.iox_root()) == before_on_disk)
                .then_some(())
        });
        own.write(&round);
        assert_eq!(
            session.open_board::<u64>(own.service()).unwrap().read(),
            round
        );
    }
}

/// Serves, publishes and writes until the end; other processes may die meanwhile.
fn host(session: &Session, cell: &Cell, end: &AtomicBool) {
    let mut board = session.create_board::<u64>("board").unwrap();
    let mut publisher = session.publisher::<[u64; 8]>("stream").unwrap();
    let server = session.serve("server").unwrap();
    let announcement = session
        .announcement()
        .service("board", board.service())
        .service("stream", publisher.service())
        .service("server", server.service());
    let _announced = cell.announce(&announcement).unwrap();
    for value in 0.. {
        if end.load(Ordering::Relaxed) {
            return;
        }
        board.write(&(value * 97));
        publisher.publish(&[[value; 8]; 3]).unwrap();
        while let Some(request) = server.poll().unwrap() {
            request.answer(&[1; 5_000]).unwrap();
        }
        std::thread::sleep(Duration::from_micros(200));
    }
}

#[test]
fn guests_killed_at_any_moment_use_up_nothing_of_a_living_process() {
    let cell = TestCell::new();
    let end = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let session = Session::join(&cell, Role::Executor, "exec").unwrap();
            host(&session, &cell, &end);
        });
        let announced = wait_for(|| cell.announced(Role::Executor, "exec").unwrap());
        let outcome = std::panic::catch_unwind(|| {
            // More rounds than any of the services has places.
            for delay_us in random_delays_us(60) {
                let peer = Peer::start(&cell, "guest", "guest");
                fs::remove_file(wait_until_started(&cell)).unwrap();
                std::thread::sleep(Duration::from_micros(delay_us));
                peer.kill();
                run_janitor(&cell).unwrap();
            }
            let session = Session::join(&cell, Role::Monitor, "last").unwrap();
            let readers: Vec<_> = (0..board::READERS_MAX)
                .map(|_| {
                    session
                        .open_board::<u64>(&announced.services["board"])
                        .unwrap()
                })
                .collect();
            let clients: Vec<_> = (0..request::CLIENTS_MAX)
                .map(|_| session.client(&announced.services["server"]).unwrap())
                .collect();
            for client in &clients {
                assert_eq!(client.call(b"?", LIMIT).unwrap(), [1; 5_000]);
            }
            let mut streams: Vec<_> = (0..stream::SUBSCRIBERS_MAX)
                .map(|_| {
                    session
                        .subscribe::<[u64; 8]>(&announced.services["stream"])
                        .unwrap()
                })
                .collect();
            for stream in &mut streams {
                wait_for(|| stream.next_batch().unwrap());
            }
            drop(readers);
        });
        end.store(true, Ordering::Relaxed);
        if let Err(panic) = outcome {
            std::panic::resume_unwind(panic);
        }
    });
}
