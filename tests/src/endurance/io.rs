//! Kills and restarts the I/O driver while the arm moves; in a fifth of the cases a net on the station loses its
//! device. Runs on one thread, which also starts the I/O driver.

use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use super::field::{Field, IO, count, held};
use super::restart;
use crate::nets;

/// Pause between two restarts, in which other threads can use the station.
const BREATH: Duration = Duration::from_millis(5);

/// Runs until the journal ends.
pub fn run(field: &Field<'_>) {
    let pid = held(&field.io_driver).start(field.place);
    let mut watch = field.place.watch();
    let mut random = field.random(2);
    field.await_driver(&watch, IO, pid);
    let begun = Instant::now();
    // Four fifths of all restarts are those of this driver, spread evenly over the time if the machine is fast enough.
    let share = u32::try_from(field.options.restarts * 4 / 5).unwrap_or(u32::MAX);
    let every = field.options.time / share.max(1);
    let mut done = 0;
    field.journal.rounds("io", |number| {
        field.renew(&mut watch);
        restart::driver(field, &mut held(&field.io_driver), &watch, IO);
        let early = (every * done).saturating_sub(begun.elapsed());
        field
            .journal
            .pause(early.clamp(BREATH, Duration::from_secs(1)));
        if field.counts.restarts() >= field.options.restarts || early > Duration::from_secs(1) {
            return;
        }
        done += 1;
        let mut driver = held(&field.io_driver);
        restart::driver(field, &mut driver, &watch, IO);
        let lamp = random.percent(20).then(|| {
            let name = format!("lamp-{number}");
            let lamp = field.load(&name, &nets::lamp(&name));
            field.start(lamp);
            lamp
        });
        std::thread::sleep(random.time_below(Duration::from_millis(50)));
        field.journal.note("kill the I/O driver".to_owned());
        driver.end(Signal::SIGKILL);
        let mut pid = driver.start(field.place);
        count(&field.counts.io_restarts);
        if random.percent(10) {
            std::thread::sleep(random.time_below(Duration::from_millis(50)));
            driver.end(Signal::SIGKILL);
            pid = driver.start(field.place);
            count(&field.counts.io_starts_killed);
        }
        field.clean();
        field.await_driver(&watch, IO, pid);
        if let Some(lamp) = lamp {
            let row = field.await_end(lamp);
            assert_eq!(row["fault"]["fault"], "device lost", "{row}");
            field.unload(lamp);
            count(&field.counts.lamps);
        }
    });
    field.end(&mut held(&field.io_driver));
}
