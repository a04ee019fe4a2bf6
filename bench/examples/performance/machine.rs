//! The head of a report: the machine, the time, the versions, and the method.

use std::error::Error;
use std::fs;
use std::process::Command;

use rcc_bench::measure::Effort;

/// Returns the head; `console` shows how the page is created.
pub fn section(title: &str, console: &str, effort: &Effort) -> Result<String, Box<dyn Error>> {
    let cpu = fs::read_to_string("/proc/cpuinfo")?;
    let value = |name: &str| {
        let line = cpu.lines().find(|line| line.starts_with(name))?;
        line.split_once(':')
            .map(|(_, value)| value.trim().to_owned())
    };
    let model = value("model name").unwrap_or_else(|| "unknown processor".into());
    let cores = cpu
        .lines()
        .filter(|line| line.starts_with("processor"))
        .count();
    let virtual_machine = value("flags").is_some_and(|flags| flags.contains(" hypervisor"));
    let kernel = fs::read_to_string("/proc/sys/kernel/osrelease")?;
    let preempt_rt =
        fs::read_to_string("/sys/kernel/realtime").is_ok_and(|text| text.trim() == "1");
    let load = fs::read_to_string("/proc/loadavg")?;
    Ok(format!(
        "# {title}\n\n\
         Made by a program; do not edit:\n\n\
         ```console\n\
         {console}\
         ```\n\n\
         {date}, commit {commit}, {compiler}; {model}, {cores} cores{vm}, Linux {kernel}{rt}; load average when it began: {load}; \
         this program {policy}.\n\n\
         Only ratios within one run carry over to other machines. Subjects are measured in turns, {rounds} rounds of {stretches} \
         stretches of {stretch} ms, hot: a round's figure is the median of its stretches, the figure in a table the median of the \
         rounds, in brackets the fastest and the slowest round. A load above 1 means that other programs ran meanwhile: it widens \
         the brackets.\n",
        date = output("date", &["-u", "+%F %H:%M UTC"])?,
        commit = output("git", &["rev-parse", "--short", "HEAD"])?,
        compiler = output("rustc", &["--version"])?,
        vm = if virtual_machine {
            " of a virtual machine"
        } else {
            ""
        },
        kernel = kernel.trim(),
        policy = if real_time()? {
            "under SCHED_FIFO"
        } else {
            "not real-time"
        },
        rt = if preempt_rt {
            " PREEMPT_RT"
        } else {
            ", not PREEMPT_RT"
        },
        load = load.split(' ').next().unwrap_or("unknown"),
        rounds = effort.rounds,
        stretches = effort.stretches,
        stretch = effort.stretch.as_millis(),
    ))
}

/// Returns true if this process runs under SCHED_FIFO: field 41 of proc_pid_stat(5), the 39th after the name.
fn real_time() -> Result<bool, Box<dyn Error>> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    let (_, fields) = stat.rsplit_once(')').ok_or("no name in /proc/self/stat")?;
    Ok(fields.split_whitespace().nth(38) == Some("1"))
}

/// Returns the output of a program.
fn output(program: &str, arguments: &[&str]) -> Result<String, Box<dyn Error>> {
    let output = Command::new(program).args(arguments).output()?;
    Ok(String::from_utf8(output.stdout)?.trim().to_owned())
}
