//! Prints a net of a thousand primitives: `cargo run -p rcc-net --example thousand | rcc-cli load -`. It is a chain of
//! low-pass filters, each of which moves half-way towards the one before.

use rcc_net::{BuildError, NetBuilder, Real};

fn main() -> Result<(), BuildError> {
    let net = NetBuilder::new("thousand");
    net.describe("A chain of 332 filters behind the time since START.");
    let mut last = net.time("time").out;
    for stage in 0..332 {
        let before = net.delayed::<Real>("0 s");
        let way = net.subtract(&format!("way_{stage}"), last, before);
        let step = net.multiply(&format!("step_{stage}"), way.out, 0.5);
        let filtered = net.add(&format!("filtered_{stage}"), step.out, before);
        before.feed(filtered.out);
        last = filtered.out;
    }
    let cancel = net.cancel("cancel");
    net.monitor("watch", last);
    net.termination("end", cancel.requested);
    print!("{}", net.to_yaml()?);
    Ok(())
}
