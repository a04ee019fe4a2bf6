//! The activities around the loader: killing it, loading big nets, and flooding it with requests.
//! Each runs on its own thread; the first one starts the loader.

use std::fmt::Write as _;
use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_os::clock::monotonic_ns;

use super::field::{Field, count, held};
use crate::nets;

/// Starts the loader; under load, kills and restarts it every 10 s to 30 s.
pub fn loader(field: &Field<'_>) {
    field.start_loader(&mut held(&field.loader));
    let mut random = field.random(3);
    let mut until_next = 20_000;
    field.journal.rounds("loader", |_| {
        field.restart_loader(&mut held(&field.loader));
        field.journal.pause(Duration::from_millis(200));
        until_next -= 200_i64;
        if until_next > 0 || !field.options.load {
            return;
        }
        until_next = 10_000 + random.below(20_000) as i64;
        field.journal.note("kill the loader".to_owned());
        let mut loader = held(&field.loader);
        loader.end(if random.percent(80) {
            Signal::SIGKILL
        } else {
            Signal::SIGTERM
        });
        std::thread::sleep(random.time_below(Duration::from_millis(100)));
        field.start_loader(&mut loader);
        count(&field.counts.loaders);
        field.clean();
    });
    field.end(&mut held(&field.loader));
}

/// Loads big nets, runs those below 400 sums, and unloads them.
pub fn big_nets(field: &Field<'_>) {
    let mut random = field.random(4);
    field.journal.rounds("big nets", |number| {
        let size = 50 + random.below(1450);
        let name = format!("big-{number}");
        field.journal.note(format!("load {name} of {size}"));
        let id = field.load(&name, &big_net(&name, size));
        count(&field.counts.big_nets);
        if size < 400 {
            field.start(id);
            field
                .journal
                .pause(random.time_below(Duration::from_millis(500)));
            field.stop(id, "cancel");
            let row = field.await_end(id);
            assert_eq!(row["reason"], "canceled", "{row}");
            count(&field.counts.big_runs);
        }
        field.unload(id);
        field
            .journal
            .pause(random.time_below(Duration::from_millis(800)));
    });
}

/// Runs a small net for a moment, so that the executor publishes records.
pub fn publish(field: &Field<'_>) {
    let name = format!("publish-{}", monotonic_ns());
    let id = field.load(&name, &nets::clock(&name));
    field.start(id);
    std::thread::sleep(Duration::from_millis(50));
    field.stop(id, "cancel");
    field.await_end(id);
    field.unload(id);
}

/// Returns the text of a net with a chain of `size` sums, whose result is monitored.
fn big_net(name: &str, size: u64) -> String {
    let mut text = format!("net: {name}\nprimitives:\n  clock: {{type: Time}}\n");
    let mut before = "clock.out".to_owned();
    for number in 0..size {
        let line = format!("  s{number}: {{type: Add, inputs: {{a: {before}, b: 1 s}}}}\n");
        text.push_str(&line);
        before = format!("s{number}.out");
    }
    // Writing to a string does not fail.
    let _ = write!(
        text,
        "  cancel: {{type: Cancel}}\n  end: {{type: Termination, inputs: {{done: cancel.requested}}}}\n  \
         watch: {{type: Monitor, parameters: {{rate: 1000 Hz}}, inputs: {{value: {before}}}}}\n"
    );
    text
}

/// Sends bursts of valid and invalid requests.
pub fn flood(field: &Field<'_>, number: u64) {
    let mut random = field.random(20 + number);
    field.journal.rounds("flood", |_| {
        field.journal.note(format!("flood {number} begins"));
        for _ in 0..200 + random.below(600) {
            if field.journal.is_over() {
                return;
            }
            let _ = match random.below(6) {
                0 => field.try_ask("GET", "/status", ""),
                1 => field.try_ask("GET", "/commands", ""),
                2 => field.try_ask("GET", "/devices", ""),
                3 => field.try_ask("GET", "/commands/999999", ""),
                4 => field.try_ask("POST", "/commands/nobody/start", ""),
                _ => field.try_ask("DELETE", "/", &"x".repeat(random.below(5000) as usize)),
            };
        }
        field.journal.note(format!("flood {number} ends"));
        field
            .journal
            .pause(Duration::from_secs(1) + random.time_below(Duration::from_secs(4)));
    });
}
