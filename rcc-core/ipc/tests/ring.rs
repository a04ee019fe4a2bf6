//! Rings between one writer and its readers, and the set-points of a device on one. Run by the test program's threads.

mod common;

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use common::{TestCell, refused};
use rcc_core::message::{CommandImage, SET_POINTS, SetPoint};
use rcc_ipc::{BoardError, Session};
use rcc_protocol::Role;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const LENGTH: u32 = 8;

#[test]
fn a_reader_finds_the_last_values_with_their_contents() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut writer = session
        .create_ring::<u64, [u64; 4]>("ring", LENGTH)
        .unwrap();
    let reader = session
        .open_ring::<u64, [u64; 4]>(writer.service(), LENGTH)
        .unwrap();
    assert_eq!((reader.head(), reader.at(3)), (0, [0; 4]));
    for number in 1..=20 {
        writer.write(number, &[number; 4], &(100 * number));
    }
    assert_eq!(reader.head(), 2000);
    for number in 13..=20 {
        assert_eq!(reader.at(number), [number; 4]);
    }
    assert_eq!(reader.at(12), [20; 4], "overwritten");
}

#[test]
fn another_layout_or_length_is_refused() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let writer = session
        .create_ring::<u64, [u64; 4]>("ring", LENGTH)
        .unwrap();
    let service = writer.service();
    let longer = refused(session.open_ring::<u64, [u64; 4]>(service, LENGTH + 1));
    let other = refused(session.open_ring::<u64, [u64; 5]>(service, LENGTH));
    let head = refused(session.open_ring::<u32, [u64; 4]>(service, LENGTH));
    for error in [longer, other, head] {
        assert!(matches!(error, BoardError::OtherLayout { .. }), "{error}");
    }
}

fn point(position: f64) -> SetPoint {
    SetPoint {
        has_position: 1,
        position: [position; 8],
        ..SetPoint::NONE
    }
}

#[test]
fn a_driver_finds_the_set_points_it_missed_and_no_others() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut writer = session.create_commands("command-lwr").unwrap();
    let mut reader = session.open_commands(writer.service()).unwrap();
    let mut image = CommandImage::new(7, 1_000_000);
    // Nothing is published before the first cycle.
    writer.write(&image);
    assert_eq!(reader.read().head.sequence, 0);
    let mut write = |numbers: std::ops::RangeInclusive<u64>| {
        for number in numbers {
            image.push(number, number, point(number as f64));
            writer.write(&image);
        }
    };
    let kept = |image: &CommandImage| -> Vec<u64> {
        (0..1000)
            .filter(|number| image.at(*number).is_some())
            .collect()
    };
    write(1..=3);
    assert_eq!(kept(reader.read()), [1, 2, 3]);
    write(4..=100);
    assert_eq!(kept(reader.read()), (1..=100).collect::<Vec<_>>());
    write(101..=400);
    let image = reader.read();
    let oldest = 401 - SET_POINTS as u64;
    assert_eq!(kept(image), (oldest..=400).collect::<Vec<_>>());
    let position = |number| image.at(number).map(|point| point.position[0]);
    assert!((oldest..=400).all(|number| position(number) == Some(number as f64)));
    assert_eq!((image.head.executor, image.head.stamp_ns), (7, 400));
}

#[test]
fn writing_and_reading_allocate_nothing() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut writer = session.create_commands("command-lwr").unwrap();
    let mut reader = session.open_commands(writer.service()).unwrap();
    let mut image = CommandImage::new(7, 1_000_000);
    let sum = assert_no_alloc(|| {
        let mut sum = 0.0;
        for number in 1..1000 {
            image.push(number, number, point(1.0));
            writer.write(&image);
            sum += reader
                .read()
                .at(number)
                .map_or(0.0, |point| point.position[0]);
        }
        sum
    });
    assert_eq!(sum, 999.0);
}

#[test]
fn values_up_to_the_head_are_present_during_writes() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();
    let mut writer = session.create_commands("command-lwr").unwrap();
    let mut reader = session.open_commands(writer.service()).unwrap();
    const LAST: u64 = 100_000;
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let mut image = CommandImage::new(7, 1_000_000);
            for number in 1..=LAST {
                image.push(number, number, point(number as f64));
                writer.write(&image);
                for _ in 0..200 {
                    std::hint::spin_loop();
                }
            }
        });
        let mut holes = 0;
        let mut looks = 0u64;
        loop {
            let before = reader.head().sequence;
            let image = reader.read();
            let newest = image.head.sequence;
            looks += 1;
            let first = newest.saturating_sub(20).max(1);
            let missing: Vec<_> = (first..=newest)
                .map(|number| {
                    (
                        number,
                        image.at(number).map(|point| point.position[0] as u64),
                    )
                })
                .filter(|(number, found)| *found != Some(*number))
                .collect();
            // A reader that was descheduled during the look may find its values overwritten.
            let calm = reader.head().sequence - before < 100;
            if calm && !missing.is_empty() {
                holes += missing.len();
                eprintln!("of {newest} (before {before}): {missing:?}");
            }
            if newest == LAST {
                break;
            }
        }
        eprintln!("{looks} looks");
        assert_eq!(holes, 0);
    });
}
