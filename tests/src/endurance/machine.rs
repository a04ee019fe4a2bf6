//! Load on the machine itself (processor, disk, memory) without real-time priority.
//! Each runs on its own thread; the processor load runs on two.

use std::fs::File;
use std::io::Write;
use std::time::{Duration, Instant};

use super::field::Field;

/// Computes for 3 s, then pauses for 8 s.
pub fn processor(field: &Field<'_>) {
    field.journal.rounds("processor", |number| {
        field.journal.note("a busy loop begins".to_owned());
        let begun = Instant::now();
        let mut value = number;
        while begun.elapsed() < Duration::from_secs(3) && !field.journal.is_over() {
            for _ in 0..100_000 {
                value = std::hint::black_box(
                    value
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1),
                );
            }
        }
        field.journal.note("a busy loop ends".to_owned());
        field.journal.pause(Duration::from_secs(8));
    });
}

/// Writes 32 MiB, syncs the file to the disk and removes it, every 3 s.
pub fn disk(field: &Field<'_>) {
    let path = std::env::temp_dir().join(format!("rcc-endurance-{}.load", std::process::id()));
    let block = vec![7_u8; 1 << 20];
    field.journal.rounds("disk", |_| {
        field.journal.note("write to the disk".to_owned());
        let mut file = File::create(&path).expect("a temporary file");
        for _ in 0..32 {
            file.write_all(&block).expect("room on the disk");
        }
        file.sync_all().expect("the disk works");
        drop(file);
        std::fs::remove_file(&path).expect("it was just made");
        field.journal.pause(Duration::from_secs(3));
    });
}

/// Allocates and touches 256 MiB, and frees it after 0.5 s.
pub fn memory(field: &Field<'_>) {
    field.journal.rounds("memory", |number| {
        field.journal.note("take memory".to_owned());
        let taken = vec![(number % 251) as u8 + 1; 256 << 20];
        std::hint::black_box(&taken);
        field.journal.pause(Duration::from_millis(500));
        drop(taken);
        field.journal.note("give memory back".to_owned());
        field.journal.pause(Duration::from_secs(5));
    });
}
