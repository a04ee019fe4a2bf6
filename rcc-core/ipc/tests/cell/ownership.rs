//! Cells that several processes acquire and release, and files of another user. Run by the threads of the test harness.

use super::*;

/// Only root can create files of another user.
#[test]
fn a_file_of_another_user_under_the_prefix_does_not_block_the_cell() {
    if !nix::unistd::getuid().is_root() {
        println!("skipped: creating files of another user needs root");
        return;
    }
    let first = TestCell::new();
    drop(Session::join(&first, Role::Loader, "loader").unwrap());
    let common = first.files().remove(0);
    fs::remove_file(&common).unwrap();
    fs::write(&common, [0; 16]).unwrap();
    std::os::unix::fs::chown(&common, Some(65534), None).unwrap();
    // A handle from before the change is refused; a new look-up finds a usable prefix.
    let error = refused(Session::join(&first, Role::Loader, "loader")).to_string();
    let again = Cell::at("test", first.runtime_dir()).unwrap();
    let joined = Session::join(&again, Role::Loader, "loader");
    // While the cell lives, a foreign file does not keep processes out.
    let beside = PathBuf::from("/dev/shm").join(format!("{}beside.global_mgmt", again.prefix()));
    fs::write(&beside, "").unwrap();
    std::os::unix::fs::chown(&beside, Some(65534), None).unwrap();
    let second = Session::join(&again, Role::Driver, "lwr").map(drop);
    let same = Cell::at("test", first.runtime_dir()).unwrap();
    let late = refused(Session::join(&first, Role::Monitor, "late")).to_string();
    let board = joined
        .as_ref()
        .unwrap()
        .create_board::<u64>("board")
        .map(drop);
    drop(joined);
    let wiped = clean::wipe(&again);
    clean::remove_cell(&again).unwrap();
    let stays = common.exists();
    fs::remove_file(&common).unwrap();
    fs::remove_file(&beside).unwrap();
    assert_eq!(same, again, "a living cell keeps its prefix");
    second.unwrap();
    board.unwrap();
    wiped.unwrap();
    assert!(stays, "the file of another user stays");
    assert!(
        error.contains("(uid 65534)") && error.contains("--cell"),
        "{error}"
    );
    assert_ne!(again.prefix(), first.prefix());
    assert!(late.contains("recreated"), "{late}");
    assert!(again.leftovers().unwrap().is_empty());
}

/// Files of the owner of a cell: one that belongs to its run and one in shared memory.
fn keep(cell: &Cell, who: usize) -> [PathBuf; 2] {
    let shared = Path::new("/dev/shm").join(format!("{}kept", cell.prefix()));
    let kept = [cell.running_file(), shared];
    for path in &kept {
        fs::write(path, who.to_string()).unwrap();
    }
    kept
}

#[test]
fn of_concurrent_acquirers_one_gets_the_cell_and_keeps_its_files() {
    let cell = TestCell::new();
    let barrier = std::sync::Barrier::new(8);
    for round in 0..100 {
        if round % 2 == 1 {
            // Left by a run that died.
            keep(&Cell::at("test", cell.runtime_dir()).unwrap(), 99);
        }
        let taken: Vec<_> = std::thread::scope(|scope| {
            let takers: Vec<_> = (0..8)
                .map(|who| {
                    let (cell, barrier) = (&cell, &barrier);
                    scope.spawn(move || {
                        barrier.wait();
                        let taken = acquire(cell, &Announcement::supervisor().unwrap());
                        taken.map(|announced| (announced, who, keep(cell, who)))
                    })
                })
                .collect();
            takers
                .into_iter()
                .map(|taker| taker.join().unwrap())
                .collect()
        });
        let mut has = None;
        for result in taken {
            match result {
                Ok(taken) => assert!(has.replace(taken).is_none(), "two processes own the cell"),
                Err(error) => assert!(
                    matches!(error, WipeError::Living { role: Role::Cli, pid, .. } if pid == std::process::id()),
                    "{error}"
                ),
            }
        }
        let (announced, who, kept) = has.expect("one owns it");
        for path in kept {
            assert_eq!(
                fs::read_to_string(path).unwrap(),
                who.to_string(),
                "round {round}"
            );
        }
        assert!(cell.announced_all().unwrap()[0].is_supervisor());
        release(&cell, &announced).unwrap();
        drop(announced);
        assert!(!cell.runtime_dir().exists() && cell.leftovers().unwrap().is_empty());
    }
}

#[test]
fn a_cell_released_under_contention_never_mixes_two_owners() {
    let cell = TestCell::new();
    let having = std::sync::atomic::AtomicUsize::new(0);
    let lives = std::sync::atomic::AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for who in 0..6 {
            let (cell, having, lives) = (&cell, &having, &lives);
            scope.spawn(move || {
                while lives.load(std::sync::atomic::Ordering::SeqCst) < 200 {
                    // Like a starting process: finds or creates the folder of the cell.
                    let own = Cell::at("test", cell.runtime_dir()).unwrap();
                    let announced = match acquire(&own, &Announcement::supervisor().unwrap()) {
                        Ok(announced) => announced,
                        Err(WipeError::Living { .. }) => continue,
                        Err(error) => panic!("{error}"),
                    };
                    assert_eq!(having.fetch_add(1, std::sync::atomic::Ordering::SeqCst), 0);
                    let kept = keep(&own, who);
                    std::thread::yield_now();
                    for path in kept {
                        assert_eq!(fs::read_to_string(path).unwrap(), who.to_string());
                    }
                    lives.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
                    having.fetch_sub(1, std::sync::atomic::Ordering::SeqCst);
                    release(&own, &announced).unwrap();
                }
            });
        }
    });
    assert!(cell.leftovers().unwrap().is_empty());
}
