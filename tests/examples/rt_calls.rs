//! Counts the system calls of the real-time thread in 100,000 cycles while nets, monitors, drivers and loaders start
//! and end. Runs on the main thread. Usage: `cargo run -p rcc-tests --example rt_calls [CYCLES]`

use rcc_tests::rt_calls::count;

fn main() -> Result<(), String> {
    rcc_tests::cell::without_time_limit();
    let cycles = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let counted = count(cycles.unwrap_or(100_000))?;
    let [nets, switches, monitors, drivers, loaders] = counted.happened;
    println!(
        "{} cycles: {} sleeps, other system calls: {:?}; meanwhile {nets} motions, {switches} hand-overs, {monitors} monitors, \
         {drivers} drivers and {loaders} loaders killed and started",
        counted.cycles,
        counted.sleeps(),
        counted.others()
    );
    if counted.others().is_empty() {
        Ok(())
    } else {
        Err("the real-time thread makes system calls other than its sleep".to_owned())
    }
}
