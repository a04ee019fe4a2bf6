//! Diagnosis of a device connection, stage by stage, from the configuration to the device's own state. Run by the main
//! thread; stages are functions of facts, and the report ends with the first failed stage.

use rcc_config::link::is_link_program;
use serde::Serialize;

use super::driver_status::{DriverStatus, LinkHistory};
use super::{FindingLevel, HealthFinding};

pub mod ethercat;
pub mod fri;
pub mod gather;
pub mod iiwa;
pub mod peer;
pub mod plain;
pub mod sockets;

/// Facts about one device.
#[derive(Clone, Debug, Default)]
pub struct LinkFacts {
    /// Name of the device.
    pub device: String,
    /// Name of its driver.
    pub driver: String,
    /// Settings of the driver.
    pub settings: serde_json::Value,
    /// File of the cell's configuration.
    pub source: String,
    /// Period of the executor, ns.
    pub period_ns: u64,
    /// Automatic ports whose numbers are unknown because the cell does not run.
    pub unknown_ports: Vec<String>,
    /// True if the cell has simulators.
    pub simulated: bool,
    /// Process id of the living driver.
    pub pid: Option<u32>,
    /// The driver's newest status.
    pub driver_status: Option<DriverStatus>,
    /// The driver's status about a second before.
    pub previous_status: Option<DriverStatus>,
    /// Result of listening in the driver's place.
    pub probe: Option<serde_json::Value>,
    /// Reason why listening failed.
    pub no_probe: Option<String>,
    /// Network interfaces of this machine.
    pub interfaces: Vec<sockets::NetworkInterface>,
    /// State of the network interface that `settings.interface` names: it is up, and it has a cable; `None` if it names none.
    pub nic: Option<(bool, bool)>,
    /// Process that holds the device's port.
    pub holder: Option<String>,
    /// Result of connecting to the server; `None` if not tried.
    pub connects: Option<Result<(), String>>,
}

impl LinkFacts {
    /// Returns the driver-specific diagnosis, from the driver or from listening in its place.
    #[must_use]
    pub fn link(&self) -> &serde_json::Value {
        match (&self.driver_status, &self.probe) {
            (Some(status), _) => &status.link,
            (None, Some(probe)) => &probe["link"],
            (None, None) => &serde_json::Value::Null,
        }
    }

    /// Returns a counter of [`LinkFacts::link`] since the start.
    #[must_use]
    pub fn total(&self, key: &str) -> u64 {
        self.link()[key].as_u64().unwrap_or(0)
    }

    /// Returns the increase of a counter during the check.
    #[must_use]
    pub fn grown(&self, key: &str) -> u64 {
        let before = self
            .previous_status
            .as_ref()
            .and_then(|before| before.link[key].as_u64());
        self.total(key).saturating_sub(before.unwrap_or(0))
    }

    /// Returns true if a driver answers the device, so that the device's quality rating is meaningful.
    #[must_use]
    pub fn is_answered(&self) -> bool {
        self.driver_status.is_some()
    }
}

/// A stage: its name, and a function that returns a finding or nothing.
pub type LinkStage = (&'static str, fn(&LinkFacts) -> Option<HealthFinding>);

/// Report about one device; keys are only ever added.
#[derive(Clone, Debug, Serialize)]
pub struct LinkReport {
    /// Version of the format, 1.
    pub schema: u32,
    /// Device.
    pub device: String,
    /// Driver.
    pub driver: String,
    /// The failed stage, if any.
    pub failed: Option<&'static str>,
    /// Findings in order; the last one is the failure.
    pub findings: Vec<HealthFinding>,
    /// The last minute, if a driver runs.
    pub history: Option<LinkHistory>,
    /// Driver-specific diagnosis.
    pub link: serde_json::Value,
}

impl LinkReport {
    /// Runs the stages for the driver.
    #[must_use]
    pub fn of(facts: &LinkFacts) -> LinkReport {
        let stages: &[LinkStage] = match facts.driver.as_str() {
            "ethercat" => ethercat::STAGES,
            "fri-lwr" => fri::STAGES,
            "fri-iiwa" => iiwa::STAGES,
            driver if is_link_program(driver) => peer::STAGES,
            _ => plain::STAGES,
        };
        let mut findings = Vec::new();
        let mut failed = None;
        for (name, stage) in stages {
            let Some(finding) = stage(facts) else {
                continue;
            };
            let fails = finding.level == FindingLevel::Fail;
            findings.push(HealthFinding {
                check: name,
                ..finding
            });
            if fails {
                failed = Some(*name);
                break;
            }
        }
        LinkReport {
            schema: 1,
            device: facts.device.clone(),
            driver: facts.driver.clone(),
            failed,
            findings,
            history: facts.driver_status.as_ref().map(DriverStatus::history),
            link: facts.link().clone(),
        }
    }

    /// Formats the report for people.
    #[must_use]
    pub fn human(&self) -> String {
        let mut text: String = self.findings.iter().map(super::report::lines).collect();
        if let Some(history) = &self.history {
            text.push_str(&format!(
                "\nlast {} s  {}\n           quality mean {} min {}   late or lost answers {} ({} since the driver started, {} ago)\n",
                history.seconds,
                history.sparkline,
                percent(history.quality_mean_permille),
                percent(history.quality_min_permille),
                history.late,
                history.late_total,
                super::record::age(super::driver_status::now().saturating_sub(history.since)),
            ));
        }
        let name = &self.device;
        text.push_str(&match (self.failed, &self.history) {
            (Some(stage), _) => {
                format!("\n{name} does not work: stage `{stage}` failed; later stages were not checked.\n")
            }
            (None, Some(_)) => format!("\n{name} works\n"),
            (None, None) => format!("\n{name} is reachable; the remaining stages need a running driver\n"),
        });
        text
    }
}

/// Formats thousandths as percent.
#[must_use]
pub fn percent(permille: u32) -> String {
    format!("{:.1} %", f64::from(permille) / 10.0)
}

/// Stage: the configuration is usable.
fn configuration(facts: &LinkFacts) -> Option<HealthFinding> {
    if facts.unknown_ports.is_empty() {
        return None;
    }
    let ports = facts.unknown_ports.join(", ");
    Some(
        HealthFinding::fail(
            format!("the cell does not run, and its file assigns {ports} automatically at start"),
            format!(
                "start the cell (`rcc-cli up {}`), or set fixed numbers in its `ports`",
                facts.source
            ),
        )
        .cause("the port to listen on is unknown"),
    )
}

/// Stage: the driver is alive and reports its status.
fn driver(facts: &LinkFacts) -> Option<HealthFinding> {
    let pid = facts.pid?;
    let Some(status) = &facts.driver_status else {
        return Some(HealthFinding::fail(
            format!("the driver runs (pid {pid}) but has not reported its status yet"),
            "retry in two seconds; if it persists, check the driver's log",
        ));
    };
    if status.history().stale {
        return Some(
            HealthFinding::fail(
                format!("the driver (pid {pid}) has not reported its status for {} s", super::driver_status::now().saturating_sub(status.at)),
                format!("continue or restart it: kill -CONT {pid}; `rcc-cli up` and systemd restart hung processes"),
            )
            .cause("it is stopped or hung"),
        );
    }
    Some(HealthFinding::ok(format!(
        "driver {} runs (pid {pid}), for {}",
        facts.driver,
        super::record::age(super::driver_status::now().saturating_sub(status.since))
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn automatic_ports_of_a_cell_that_does_not_run_fail_first() {
        let facts = LinkFacts {
            driver: "fri-lwr".to_owned(),
            device: "lwr".to_owned(),
            unknown_ports: vec!["fri".to_owned()],
            ..LinkFacts::default()
        };
        let report = LinkReport::of(&facts);
        assert_eq!(
            (report.failed, report.findings.len()),
            (Some("configuration"), 1)
        );
        assert!(
            report
                .human()
                .contains("lwr does not work: stage `configuration`")
        );
    }

    #[test]
    fn a_driver_that_stopped_reporting_fails() {
        let mut facts = LinkFacts {
            pid: Some(7),
            ..LinkFacts::default()
        };
        assert_eq!(
            driver(&facts).map(|finding| finding.level),
            Some(FindingLevel::Fail)
        );
        facts.driver_status = Some(DriverStatus {
            at: super::super::driver_status::now() - 60,
            ..DriverStatus::default()
        });
        let found = driver(&facts);
        assert!(found.is_some_and(|found| found.what.contains("has not reported its status for")));
        facts.driver_status = Some(DriverStatus {
            at: super::super::driver_status::now(),
            ..DriverStatus::default()
        });
        assert_eq!(
            driver(&facts).map(|finding| finding.level),
            Some(FindingLevel::Ok)
        );
    }
}
