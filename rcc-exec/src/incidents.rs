//! Writes incident files: each holds a frozen recording of the real-time thread, the plans of the nets in it, and the
//! files that name their primitives. Runs in a thread of its own, which may block on the disk for any time.

use std::collections::VecDeque;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rcc_core::frame::DeviceModel;
use rcc_core::message::FaultCode;
use rcc_core::primitives;
use rcc_engine::incident::{
    self, COMMAND_FILE_MAX, EXTENSION, FORMAT, IncidentHead, IncidentParts, RingOverview,
};
use rcc_engine::net::NetOrigin;
use rcc_engine::record::{FlightRecorderHelper, FrozenRecording, TriggerReason};
use rcc_ipc::Cell;
use rcc_ipc::events::EventRecorder;
use rcc_os::clock::monotonic_ns;
use rcc_process::Helper;
use rcc_protocol::control::RecordingState;
use rcc_protocol::events::{EventKind, event_text, hex_digits, wall_time_before};
use tracing::{info, warn};

use crate::rule_texts::RuleTexts;

mod folder;

use folder::{PARTIAL_EXTENSION, make_room, remove_partial_files, writer_of};

/// Interval at which the thread checks for a frozen recording.
const POLL_EVERY: Duration = Duration::from_millis(20);
/// Interval at which the size of the state folder is checked, besides after each incident: logs grow, too.
const KEEP_EVERY: Duration = Duration::from_secs(60);
/// Interval at which unneeded plans are dropped.
const PRUNE_EVERY: Duration = Duration::from_secs(1);
/// Maximum number of plans of unloaded commands. They are kept as long as a recording may contain them, but never more
/// than this.
const UNLOADED_PLANS_MAX: usize = 256;

/// Number of recordings whose result is kept for queries.
const RECORDINGS_MAX: usize = 64;

/// Results of the last recordings. Added by the thread that writes the files, read by the intake thread.
#[derive(Clone, Debug, Default)]
pub struct RecordingResults(Arc<Mutex<VecDeque<(u64, RecordingState)>>>);

impl RecordingResults {
    fn add(&self, last_cycle: u64, recorded: RecordingState) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.push_back((last_cycle, recorded));
        if all.len() > RECORDINGS_MAX {
            all.pop_front();
        }
    }

    /// Returns the result of the recording that a request froze in `cycle`: the first one that reaches that cycle.
    #[must_use]
    pub fn find(&self, cycle: u64) -> RecordingState {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = all.iter().find(|(last_cycle, _)| *last_cycle >= cycle);
        found.map_or(RecordingState::NotYet, |(_, recorded)| recorded.clone())
    }
}

/// A file that counts a heartbeat with each write, because a disk may be slow.
struct HeartbeatWriter<'a> {
    file: &'a File,
    helper: &'a Helper,
}

impl Write for HeartbeatWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.helper.turn();
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// The id of a command that is about to be ready or to start, and the origin of its net.
pub type PreparedNet = (u64, NetOrigin);

/// The facts about the cell that each incident file contains.
#[derive(Clone, Debug)]
pub struct IncidentContext {
    /// The cell.
    pub cell: Cell,
    /// Path of the configuration file.
    pub config: String,
    /// Fingerprint of the device table.
    pub configuration: u64,
    /// Incarnation of the executor.
    pub incarnation: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// Names of the devices.
    pub devices: Vec<String>,
    /// Their models.
    pub models: Vec<DeviceModel>,
    /// Configuration of the flight recorder: what it records and what is kept.
    pub recorder: rcc_config::RecorderConfig,
}

/// A plan that is kept because a recording may contain its net.
#[derive(Debug)]
struct KeptPlan {
    id: u64,
    origin: NetOrigin,
    /// The command file that the loader wrote; it is copied without being parsed.
    file: Option<Vec<u8>>,
    /// When the net was found to be dropped; `None` while it exists.
    unloaded_at: Option<Instant>,
}

/// Writes incident files; the state of the thread `incidents`.
#[derive(Debug)]
pub struct IncidentWriter {
    context: IncidentContext,
    folder: PathBuf,
    helper: FlightRecorderHelper,
    prepared: Receiver<PreparedNet>,
    plans: VecDeque<KeptPlan>,
    pruned_at: Instant,
    log: Option<EventRecorder>,
    recordings: RecordingResults,
    rule_texts: RuleTexts,
    /// The file that was written last: the newest one, whatever the wall clock says.
    newest: Option<PathBuf>,
    /// Logs of this run of the cell.
    logs: Option<PathBuf>,
}

impl IncidentWriter {
    /// Creates a writer for the recordings of `helper`. The origin of each net that is built must be sent through the
    /// returned sender.
    pub fn new(
        context: IncidentContext,
        helper: FlightRecorderHelper,
    ) -> (IncidentWriter, Sender<PreparedNet>, RecordingResults) {
        let (sender, prepared) = channel();
        let state = context.cell.state();
        let folder = state.incidents_dir();
        let incident_writer = IncidentWriter {
            context,
            folder,
            helper,
            prepared,
            pruned_at: Instant::now(),
            plans: VecDeque::new(),
            log: None,
            recordings: RecordingResults::default(),
            rule_texts: RuleTexts::default(),
            newest: None,
            logs: state.own_logs(),
        };
        let recordings = incident_writer.recordings.clone();
        (incident_writer, sender, recordings)
    }

    /// Also writes events to the cell's event log.
    #[must_use]
    pub fn with_event_log(mut self, log: EventRecorder) -> IncidentWriter {
        self.log = Some(log);
        self
    }

    /// Names the conditions of rules that record.
    #[must_use]
    pub fn with_rule_texts(mut self, rule_texts: RuleTexts) -> IncidentWriter {
        self.rule_texts = rule_texts;
        self
    }

    /// Runs until it is asked to end; recordings frozen by then are still written.
    pub fn run(&mut self, helper: &Helper) {
        remove_partial_files(&self.folder);
        self.remove_oldest();
        let mut kept_at = Instant::now();
        while !helper.is_over() {
            helper.turn();
            match self.prepared.recv_timeout(POLL_EVERY) {
                Ok(prepared) => self.keep_plan(prepared),
                Err(RecvTimeoutError::Timeout) => {}
                // The sender is gone: the executor is ending.
                Err(RecvTimeoutError::Disconnected) => std::thread::sleep(POLL_EVERY),
            }
            if self.pruned_at.elapsed() > PRUNE_EVERY {
                self.pruned_at = Instant::now();
                self.prune_plans();
            }
            self.write_pending(helper);
            if kept_at.elapsed() > KEEP_EVERY {
                kept_at = Instant::now();
                self.remove_oldest();
            }
        }
        self.write_pending(helper);
    }

    /// Removes the oldest files of the state folder beyond the configured size.
    fn remove_oldest(&self) {
        let is_incident = |path: &Path| writer_of(path).is_some();
        let keep = self.context.recorder.keep;
        let newest: Vec<&Path> = [&self.newest, &self.logs]
            .into_iter()
            .filter_map(Option::as_deref)
            .collect();
        let state = self.context.cell.state();
        match state.remove_oldest(keep, &newest, is_incident) {
            Ok(removed) => {
                for path in removed {
                    info!(
                        "removed, because more than `keep` was kept: {}",
                        path.display()
                    );
                }
            }
            Err(error) => warn!("cannot remove the oldest files of the state folder: {error}"),
        }
    }

    fn keep_plan(&mut self, (id, origin): PreparedNet) {
        // A net that was rebuilt before its START has a new origin.
        if let Some(plan) = self.plans.iter_mut().find(|plan| plan.id == id) {
            plan.origin = origin;
            return;
        }
        let file = self.command_file(id);
        self.plans.push_back(KeptPlan {
            id,
            origin,
            file,
            unloaded_at: None,
        });
    }

    fn command_file(&self, id: u64) -> Option<Vec<u8>> {
        let folder = hex_digits(self.context.incarnation);
        let path = self.context.cell.commands_dir().join(folder);
        let path = path.join(format!("{id}.json"));
        rcc_os::file::read(&path, COMMAND_FILE_MAX as u64).ok()
    }

    /// Drops plans that no recording can contain any more, and the oldest ones beyond the maximum.
    fn prune_plans(&mut self) {
        let span = Duration::from_nanos(self.context.recorder.span_ns) * 2 + Duration::from_secs(1);
        for plan in &mut self.plans {
            // The net shares its plan with this entry: the last reference means that the net is gone.
            if plan.unloaded_at.is_none() && Arc::strong_count(&plan.origin.data) == 1 {
                plan.unloaded_at = Some(Instant::now());
            }
        }
        let old = |plan: &KeptPlan| plan.unloaded_at.is_some_and(|at| at.elapsed() > span);
        self.plans.retain(|plan| !old(plan));
        let unloaded = self
            .plans
            .iter()
            .filter(|plan| plan.unloaded_at.is_some())
            .count();
        let mut many = unloaded.saturating_sub(UNLOADED_PLANS_MAX);
        self.plans.retain(|plan| {
            let goes = many > 0 && plan.unloaded_at.is_some();
            many -= usize::from(goes);
            !goes
        });
    }

    fn write_pending(&mut self, helper: &Helper) {
        while let Ok(recording) = self.helper.recordings.pop() {
            // Receives nets that became ready meanwhile.
            while let Ok(prepared) = self.prepared.try_recv() {
                self.keep_plan(prepared);
            }
            let overview = incident::overview(&recording.ring);
            let head = self.build_head(&recording, &overview);
            let last_cycle = head.last_cycle;
            let recorded = match self.write(&recording, head.clone(), helper) {
                Ok(path) => self.report_written(&recording, &head, &path),
                Err(error) => self.report_failure(&error),
            };
            self.recordings.add(last_cycle, recorded);
            let mut ring = recording.ring;
            ring.clear();
            if self.helper.spare.push(ring).is_err() {
                // Cannot happen: the queue has one slot for each ring.
                warn!("a ring buffer of the flight recorder is lost");
            }
        }
    }

    fn build_head(&self, recording: &FrozenRecording, overview: &RingOverview) -> IncidentHead {
        let trigger = &recording.trigger;
        let (reason, net, fault) = match trigger.reason {
            TriggerReason::Fault { id, fault } => {
                let name = FaultCode::from_number(fault.code).name();
                let device = self.context.devices.get(fault.device as usize);
                let of = device.map_or_else(String::new, |device| format!(": {device}"));
                ("fault", Some(id), Some(format!("{name}{of}")))
            }
            TriggerReason::Late => ("late", None, None),
            TriggerReason::Request => ("request", None, None),
            TriggerReason::Rule { .. } => ("trigger", None, None),
        };
        let condition = match trigger.reason {
            TriggerReason::Rule { id } => {
                let condition = self.rule_texts.condition(id);
                Some(condition.unwrap_or_else(|| format!("that of rule {id}, which was removed")))
            }
            _ => None,
        };
        // `nets` lists all nets of the recording; those without a plan are listed separately.
        let ago = Duration::from_nanos(monotonic_ns().saturating_sub(trigger.stamp_ns));
        let missing = |id: &&u64| !self.plans.iter().any(|plan| plan.id == **id);
        let mut head = IncidentHead {
            format: FORMAT,
            build: concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned(),
            layout: incident::layout(),
            catalogue: hex_digits(primitives::fingerprint()),
            configuration: hex_digits(self.context.configuration),
            cell: self.context.cell.name().to_owned(),
            config: self.context.config.clone(),
            executor: hex_digits(self.context.incarnation),
            period_ns: self.context.period_ns,
            devices: self.context.devices.clone(),
            reason: reason.to_owned(),
            net,
            fault,
            condition,
            cycle: trigger.cycle,
            time: wall_time_before(ago),
            others: trigger.others,
            first_cycle: overview.first_cycle,
            last_cycle: overview.last_cycle,
            without_plan: overview.nets.iter().filter(missing).copied().collect(),
            nets: overview.nets.iter().copied().collect(),
            ..IncidentHead::default()
        };
        mark_overwritten(&mut head);
        head
    }

    /// Writes the file completely or not at all, and returns its path.
    fn write(
        &mut self,
        recording: &FrozenRecording,
        head: IncidentHead,
        helper: &Helper,
    ) -> io::Result<PathBuf> {
        let mut folder = DirBuilder::new();
        folder.recursive(true).mode(0o700).create(&self.folder)?;
        make_room(
            &self.folder,
            self.context.recorder.files,
            self.context.incarnation,
        )?;
        let wanted = |plan: &&KeptPlan| head.nets.contains(&plan.id);
        let plans: Vec<&KeptPlan> = self.plans.iter().filter(wanted).collect();
        let files: Vec<(u64, &[u8])> = plans
            .iter()
            .filter_map(|plan| Some((plan.id, plan.file.as_deref()?)))
            .collect();
        let nets: Vec<(u64, &NetOrigin)> =
            plans.iter().map(|plan| (plan.id, &plan.origin)).collect();
        let parts = IncidentParts {
            files: &files,
            models: &self.context.models,
            nets: &nets,
            ring: &recording.ring,
        };
        let name = format!("{}-{}-{}", head.executor, head.cycle, head.reason);
        let path = self.folder.join(name).with_extension(EXTENSION);
        let partial = path.with_extension(PARTIAL_EXTENSION);
        let mut options = OpenOptions::new();
        options.write(true).create(true).truncate(true).mode(0o600);
        let written = options.open(&partial).and_then(|file| {
            incident::write(
                HeartbeatWriter {
                    file: &file,
                    helper,
                },
                head,
                &parts,
            )?;
            file.sync_all()?;
            fs::rename(&partial, &path)
        });
        if let Err(error) = written {
            // An incomplete file is useless; if it cannot be removed, it counts as one of the files.
            let _ = fs::remove_file(&partial);
            return Err(error);
        }
        File::open(&self.folder)?.sync_all()?;
        self.newest = Some(path.clone());
        self.remove_oldest();
        Ok(path)
    }

    fn report_written(
        &self,
        recording: &FrozenRecording,
        head: &IncidentHead,
        path: &Path,
    ) -> RecordingState {
        info!("incident written: {}", path.display());
        let cycles = head.last_cycle.saturating_sub(head.first_cycle) + 1;
        self.tell(
            recording.trigger.cycle,
            EventKind::IncidentWritten {
                reason: head.reason.clone(),
                command: head.net,
                file: event_text(&path.display().to_string()),
                span_ms: cycles * head.period_ns / 1_000_000,
                others: head.others,
            },
        );
        RecordingState::Written {
            file: path.display().to_string(),
        }
    }

    fn report_failure(&self, error: &io::Error) -> RecordingState {
        let why = format!("{}: {error}", self.folder.display());
        warn!("cannot write incident: {why}");
        let why = event_text(&why);
        self.tell(0, EventKind::IncidentLost { why: why.clone() });
        RecordingState::Lost { why }
    }

    fn tell(&self, cycle: u64, what: EventKind) {
        if let Some(log) = &self.log {
            log.tell_in((cycle != 0).then_some(cycle), what);
        }
    }
}

/// Adds to the words about a trigger that its cycle is missing: both rings were full before one was written to the disk.
fn mark_overwritten(head: &mut IncidentHead) {
    if head.first_cycle <= head.cycle {
        return;
    }
    let cycle = head.cycle;
    let words =
        format!("cycle {cycle} was overwritten while the disk was slow, the file begins later");
    let detail = match (&mut head.fault, &mut head.condition) {
        (Some(fault), _) => fault,
        (None, condition) => condition.get_or_insert_default(),
    };
    if !detail.is_empty() {
        detail.push_str("; ");
    }
    detail.push_str(&words);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_incident_whose_cycle_was_overwritten_says_so() {
        let head = |fault: Option<&str>, first_cycle| {
            let mut head = IncidentHead {
                fault: fault.map(str::to_owned),
                cycle: 100,
                first_cycle,
                ..IncidentHead::default()
            };
            mark_overwritten(&mut head);
            (head.fault, head.condition)
        };
        assert_eq!(head(Some("driver"), 100), (Some("driver".into()), None));
        let (fault, condition) = head(Some("driver"), 101);
        let fault = fault.unwrap();
        assert!(
            fault.starts_with("driver; cycle 100 was overwritten"),
            "{fault}"
        );
        assert_eq!(condition, None);
        let (fault, condition) = head(None, 101);
        assert!(fault.is_none() && condition.unwrap().starts_with("cycle 100 was"));
    }
}
