//! `/metrics`: counts and states of the cell for Prometheus, read from the loader at each scrape. Between scrapes
//! nothing is read, and only restarts and the names that have labels are kept. Run by the serving thread.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use rcc_api::bodies::{CommandView, DeviceView, ErrorBody, StatusView, TimingView};
use rcc_api::codes;
use rcc_os::process_instance::ProcessInstance;
use rcc_os::{file, wall};
use serde::de::DeserializeOwned;
use serde_json::Value;

use self::text::TextFormat;
use super::Server;
use super::devices::diagnosis;
use super::locked::locked;

mod families;
mod text;

/// Maximum number of nets' names at a time that become labels; all others are counted together.
const NAMES_MAX: usize = 50;
/// Longest part of `/proc/stat` that is read, bytes: it grows with the processors.
const STAT_MAX: u64 = 1 << 20;
/// Clock ticks a second in `/proc` (`USER_HZ`).
const TICKS_HZ: f64 = 100.0;

/// State that is kept between scrapes.
#[derive(Debug, Default)]
pub struct ScrapeState(Mutex<SeenBefore>);

#[derive(Debug, Default)]
struct SeenBefore {
    /// Incarnation of the executor at the last scrape that found one.
    executor: Option<String>,
    restarts: u64,
    names: BTreeSet<String>,
}

/// Values of one scrape; `None` if they could not be read.
#[derive(Debug, Default)]
struct Reading {
    loader: bool,
    status: Option<StatusView>,
    timing: Option<TimingView>,
    nets: Vec<CommandView>,
    devices: Vec<DeviceReading>,
    restarts: u64,
    /// Names of nets that have labels of their own.
    names: BTreeSet<String>,
    /// Start of the executor, seconds since the epoch.
    started_s: Option<f64>,
}

/// A device as the executor sees it, and what its driver counts.
#[derive(Debug, Default)]
struct DeviceReading {
    view: DeviceView,
    /// Exchanges that were late, datagrams that were refused, times without a fresh set-point.
    driver: Option<[u64; 3]>,
}

/// Answers a scrape, in OpenMetrics if it is accepted, else in Prometheus' older text format.
pub async fn answer(State(server): State<Arc<Server>>, headers: HeaderMap) -> Response {
    let reading = Reading::of(&server).await;
    let accepted = headers.get_all(header::ACCEPT).iter();
    let mut accepted = accepted.filter_map(|value| value.to_str().ok());
    let format = match accepted.any(|value| value.contains("application/openmetrics-text")) {
        true => TextFormat::OpenMetrics,
        false => TextFormat::Prometheus,
    };
    match text::written(&server.cell, families::all(&reading), format) {
        Ok(text) => ([(header::CONTENT_TYPE, format.content_type())], text).into_response(),
        // Writing to memory does not fail.
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

impl Reading {
    async fn of(server: &Server) -> Reading {
        let (status, timing, nets, devices) = tokio::join!(
            server.loader.get("/status"),
            server.loader.get("/timing"),
            server.loader.get("/commands"),
            server.loader.get("/devices")
        );
        let silent = |error: &ErrorBody| {
            [codes::NO_LOADER.code, codes::LOADER_SILENT.code].contains(&error.code.as_str())
        };
        let loader = !status.as_ref().is_err_and(silent);
        let status: Option<StatusView> = parsed(status);
        let nets: Vec<CommandView> = parsed(nets).unwrap_or_default();
        let executor = status.as_ref().map(|status| &status.executor.incarnation);
        let (restarts, names) = server.scrapes.update(executor, &nets);
        let devices: Vec<DeviceView> = parsed(devices).unwrap_or_default();
        let driver_of = |device: &DeviceView| {
            let found = diagnosis(&server.cell, &device.name)?;
            let number = |name: &str| found[name].as_u64();
            Some([number("late")?, number("refused")?, number("starved")?])
        };
        let devices = devices.into_iter().map(|view| DeviceReading {
            driver: driver_of(&view),
            view,
        });
        Reading {
            loader,
            timing: parsed(timing),
            devices: devices.collect(),
            restarts,
            names,
            started_s: executor.and_then(|incarnation| started_s(incarnation)),
            status,
            nets,
        }
    }
}

/// An answer as its type; an unreadable one counts as none.
fn parsed<T: DeserializeOwned>(answer: Result<Value, ErrorBody>) -> Option<T> {
    serde_json::from_value(answer.ok()?).ok()
}

/// The start of a process, from its incarnation and the time of boot.
fn started_s(incarnation: &str) -> Option<f64> {
    let incarnation = u64::from_str_radix(incarnation, 16).ok()?;
    let ticks = ProcessInstance::from_incarnation(incarnation).start_time_ticks;
    let stat = file::read("/proc/stat".as_ref(), STAT_MAX).ok()?;
    let stat = String::from_utf8_lossy(&stat);
    let boot = stat.lines().find_map(|line| line.strip_prefix("btime "));
    let boot: u64 = boot?.trim().parse().ok()?;
    // A clock that was set back since the boot shows no time in the future.
    Some((boot as f64 + ticks as f64 / TICKS_HZ).min(wall::since_epoch().as_secs_f64()))
}

impl ScrapeState {
    /// Counts a restart if there is another executor than at the last scrape, and returns the number of restarts and the
    /// names that have labels.
    fn update(&self, executor: Option<&String>, nets: &[CommandView]) -> (u64, BTreeSet<String>) {
        let mut state = locked(&self.0);
        if let Some(executor) = executor {
            let former = state.executor.replace(executor.clone());
            state.restarts += u64::from(former.is_some_and(|former| former != *executor));
        }
        state.name(nets);
        (state.restarts, state.names.clone())
    }
}

impl SeenBefore {
    /// A name keeps its label while a net has it; free labels go to active nets first, then to the newest.
    fn name(&mut self, nets: &[CommandView]) {
        self.names
            .retain(|name| nets.iter().any(|net| net.net == *name));
        let mut wanted: Vec<&CommandView> = nets.iter().collect();
        wanted.sort_by_key(|net| (!net.is_active(), std::cmp::Reverse(net.id)));
        for net in wanted {
            if self.names.len() >= NAMES_MAX {
                break;
            }
            self.names.insert(net.net.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn net(id: u64, net: &str, state: &str) -> CommandView {
        CommandView {
            id,
            net: net.to_owned(),
            state: state.to_owned(),
            ..CommandView::default()
        }
    }

    #[test]
    fn labels_are_bounded_and_stay_while_a_net_has_the_name() {
        let state = ScrapeState::default();
        let mut nets: Vec<CommandView> = (0..200)
            .map(|id| net(id, &format!("n{id:03}"), "ready"))
            .collect();
        nets[3].state = "running".into();
        let (_, first) = state.update(None, &nets);
        assert_eq!(first.len(), NAMES_MAX);
        assert!(first.contains("n003") && first.contains("n199") && !first.contains("n000"));
        nets.push(net(200, "newest", "running"));
        assert_eq!(state.update(None, &nets).1, first, "no label moves");
        nets.retain(|net| net.net != "n199");
        let (_, second) = state.update(None, &nets);
        assert!(second.contains("newest") && second.len() == NAMES_MAX);
        assert!(state.update(None, &[]).1.is_empty());
    }

    #[test]
    fn another_executor_is_a_restart_and_a_missing_one_is_none() {
        let state = ScrapeState::default();
        let (one, other) = ("a1".to_owned(), "a2".to_owned());
        let restarts = |executor: Option<&String>| state.update(executor, &[]).0;
        assert_eq!(restarts(None), 0);
        assert_eq!(restarts(Some(&one)), 0);
        assert_eq!(restarts(None), 0);
        assert_eq!(restarts(Some(&one)), 0);
        assert_eq!(restarts(Some(&other)), 1);
        assert_eq!(restarts(Some(&other)), 1);
    }

    #[test]
    fn this_process_started_in_the_past() {
        let own = ProcessInstance::current().expect("a process");
        let started = started_s(&format!("{:016x}", own.incarnation())).expect("a time");
        let now = wall::since_epoch().as_secs_f64();
        assert!(
            started <= now && started > now - 86_400.0,
            "{started} {now}"
        );
        assert_eq!(started_s("no number"), None);
    }
}
