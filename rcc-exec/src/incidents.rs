//! Incident files: frozen recordings of the real-time thread are written with the plans of their nets and the files that
//! name them. Run by a thread of its own, which may wait for the disk as long as it takes.

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
use rcc_engine::record::{FrozenRecording, RecorderHelper, TriggerReason};
use rcc_ipc::control::RecordingState;
use rcc_ipc::events::{self, EventKind, EventRecorder};
use rcc_ipc::{Cell, ProcessInstance, monotonic_ns};
use rcc_process::Helper;
use tracing::{info, warn};

/// How often a frozen recording is looked for.
const POLL_EVERY: Duration = Duration::from_millis(20);
/// How often plans are looked through for those that nobody needs any more.
const PRUNE_EVERY: Duration = Duration::from_secs(1);
/// Plans of commands that were unloaded are kept as long as a recording may have them, and no more than so many.
const UNLOADED_PLANS_MAX: usize = 256;

/// A file that is being written has this extension.
const PARTIAL_EXTENSION: &str = "half";
/// What became of so many recordings is remembered.
const RECORDINGS_MAX: usize = 64;

/// The life of the executor that wrote the incident file of this name, and whether it is a half-written one; nothing for
/// files that are none of ours.
fn writer_of(path: &Path) -> Option<(ProcessInstance, bool)> {
    let partial = match path.extension()?.to_str()? {
        EXTENSION => false,
        PARTIAL_EXTENSION => true,
        _ => return None,
    };
    // As `IncidentWriter::write` names them: EXECUTOR-CYCLE-REASON.
    let mut parts = path.file_stem()?.to_str()?.splitn(3, '-');
    let (executor, cycle, reason) = (parts.next()?, parts.next()?, parts.next()?);
    let digits = executor.len() == 16 && cycle.parse::<u64>().is_ok();
    let known = digits && ["fault", "late", "request"].contains(&reason);
    let executor = u64::from_str_radix(executor, 16).ok().filter(|_| known)?;
    Some((ProcessInstance::from_incarnation(executor), partial))
}

/// What became of the last recordings: written by the thread that writes files, read by the intake thread.
#[derive(Clone, Debug, Default)]
pub struct RecordingResults(Arc<Mutex<VecDeque<(u64, Recorded)>>>);

impl RecordingResults {
    fn add(&self, last_cycle: u64, recorded: Recorded) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.push_back((last_cycle, recorded));
        if all.len() > RECORDINGS_MAX {
            all.pop_front();
        }
    }

    /// What became of the recording that was frozen by a request in this cycle: the first that goes beyond it.
    #[must_use]
    pub fn find(&self, cycle: u64) -> Recorded {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = all.iter().find(|(last_cycle, _)| *last_cycle >= cycle);
        found.map_or(RecordingState::NotYet, |(_, recorded)| recorded.clone())
    }
}

/// A file whose writer shows that it lives with each piece: a disk may be slow.
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

/// A command that is about to be ready or to start: its id, and what its net begins from.
pub type PreparedNet = (u64, NetOrigin);

/// What an incident says about the cell.
#[derive(Clone, Debug)]
pub struct IncidentContext {
    /// The cell.
    pub cell: Cell,
    /// The configuration's file.
    pub config: String,
    /// Fingerprint of the device table.
    pub configuration: u64,
    /// The life of the executor.
    pub incarnation: u64,
    /// Base period.
    pub period_ns: u64,
    /// Names of the devices.
    pub devices: Vec<String>,
    /// Their models.
    pub models: Vec<DeviceModel>,
    /// What the recorder keeps and where its files go.
    pub recorder: rcc_config::RecorderConfig,
}

/// A command whose plan is kept.
#[derive(Debug)]
struct KeptPlan {
    id: u64,
    origin: NetOrigin,
    /// The file that names it, as the loader wrote it; nobody here reads it.
    file: Option<Vec<u8>>,
    /// Since when its net does not exist any more.
    unloaded_at: Option<Instant>,
}

/// Everything that the thread owns.
#[derive(Debug)]
pub struct IncidentWriter {
    context: IncidentContext,
    folder: PathBuf,
    helper: RecorderHelper,
    prepared: Receiver<PreparedNet>,
    plans: VecDeque<KeptPlan>,
    pruned_at: Instant,
    log: Option<EventRecorder>,
    recordings: RecordingResults,
}

impl IncidentWriter {
    /// Writes what comes through `helper`; whoever makes commands tells them to the sender.
    pub fn new(
        context: IncidentContext,
        helper: RecorderHelper,
    ) -> (IncidentWriter, Sender<PreparedNet>, RecordingResults) {
        let (sender, prepared) = channel();
        let folder = context.recorder.folder.clone();
        // Of several cells that share a folder each has its own in it.
        let folder = folder.map(|folder| folder.join(context.cell.name()));
        let folder = folder.unwrap_or_else(|| context.cell.incidents_dir());
        let incident_writer = IncidentWriter {
            context,
            folder,
            helper,
            prepared,
            pruned_at: Instant::now(),
            plans: VecDeque::new(),
            log: None,
            recordings: RecordingResults::default(),
        };
        let recordings = incident_writer.recordings.clone();
        (incident_writer, sender, recordings)
    }

    /// Writes what happens to the cell's event log, too.
    #[must_use]
    pub fn with_event_log(mut self, log: EventRecorder) -> IncidentWriter {
        self.log = Some(log);
        self
    }

    /// Works until it is asked to end; what was frozen by then is still written.
    pub fn run(mut self, helper: &Helper) {
        self.remove_partial_files();
        while !helper.is_over() {
            helper.turn();
            match self.prepared.recv_timeout(POLL_EVERY) {
                Ok(prepared) => self.keep_plan(prepared),
                Err(RecvTimeoutError::Timeout) => {}
                // Nobody makes commands any more: the executor ends.
                Err(RecvTimeoutError::Disconnected) => std::thread::sleep(POLL_EVERY),
            }
            if self.pruned_at.elapsed() > PRUNE_EVERY {
                self.pruned_at = Instant::now();
                self.prune_plans();
            }
            self.write_pending(helper);
        }
        self.write_pending(helper);
    }

    fn keep_plan(&mut self, (id, origin): PreparedNet) {
        // Of a net that was prepared anew before it started, what it begins from now.
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
        let folder = events::hex_digits(self.context.incarnation);
        let path = self.context.cell.commands_dir().join(folder);
        let path = path.join(format!("{id}.json"));
        rcc_os::file::read(&path, COMMAND_FILE_MAX as u64).ok()
    }

    /// Forgets plans that no recording can have any more, and the oldest of too many.
    fn prune_plans(&mut self) {
        let span = Duration::from_nanos(self.context.recorder.span_ns) * 2 + Duration::from_secs(1);
        for plan in &mut self.plans {
            // The net shares its plan: when this one is the last, there is no net.
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
            // Plans of nets that were made ready meanwhile.
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
                // Not reached: there are as many places as rings.
                warn!("a ring of the flight recorder is lost");
            }
        }
    }

    fn build_head(&self, recording: &FrozenRecording, overview: &RingOverview) -> IncidentHead {
        let trigger = &recording.trigger;
        let (reason, net, fault) = match trigger.reason {
            TriggerReason::Fault { id, fault } => {
                let words = FaultCode::from_number(fault.code).name();
                let device = self.context.devices.get(fault.device as usize);
                let of = device.map_or_else(String::new, |device| format!(": {device}"));
                ("fault", Some(id), Some(format!("{words}{of}")))
            }
            TriggerReason::Late => ("late", None, None),
            TriggerReason::Request => ("request", None, None),
        };
        // Those whose plan is here are found out when the file is written.
        let ago = Duration::from_nanos(monotonic_ns().saturating_sub(trigger.stamp_ns));
        let missing = |id: &&u64| !self.plans.iter().any(|plan| plan.id == **id);
        IncidentHead {
            format: FORMAT,
            build: concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned(),
            layout: incident::layout(),
            catalogue: events::hex_digits(primitives::fingerprint()),
            configuration: events::hex_digits(self.context.configuration),
            cell: self.context.cell.name().to_owned(),
            config: self.context.config.clone(),
            executor: events::hex_digits(self.context.incarnation),
            period_ns: self.context.period_ns,
            devices: self.context.devices.clone(),
            reason: reason.to_owned(),
            net,
            fault,
            cycle: trigger.cycle,
            time: events::wall_time_before(ago),
            others: trigger.others,
            first_cycle: overview.first_cycle,
            last_cycle: overview.last_cycle,
            without_plan: overview.nets.iter().filter(missing).copied().collect(),
            nets: overview.nets.iter().copied().collect(),
            ..IncidentHead::default()
        }
    }

    /// Writes the file whole or not at all.
    fn write(
        &self,
        recording: &FrozenRecording,
        head: IncidentHead,
        helper: &Helper,
    ) -> io::Result<PathBuf> {
        let mut folder = DirBuilder::new();
        folder.recursive(true).mode(0o700).create(&self.folder)?;
        self.link_to_folder()?;
        self.make_room()?;
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
            // What is there of it is of no use; if it cannot be removed, it counts among the files.
            let _ = fs::remove_file(&partial);
            return Err(error);
        }
        File::open(&self.folder)?.sync_all()?;
        Ok(path)
    }

    /// The runtime folder says where the files are.
    fn link_to_folder(&self) -> io::Result<()> {
        let link_to_folder = self.context.cell.incidents_dir();
        if self.folder == link_to_folder || link_to_folder.exists() {
            return Ok(());
        }
        std::os::unix::fs::symlink(&self.folder, link_to_folder)
    }

    /// Removes half-written files whose writer is dead: an executor that was killed while it wrote.
    fn remove_partial_files(&self) {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        for path in entries.map(|entry| entry.path()) {
            let dead = writer_of(&path)
                .is_some_and(|(life, partial)| partial && life.liveness().is_dead());
            if dead && let Err(error) = fs::remove_file(&path) {
                warn!("{}: {error}; it counts among the incidents", path.display());
            }
        }
    }

    /// Removes the oldest files, whole or half, until there is room for one more.
    fn make_room(&self) -> io::Result<()> {
        let mut files = Vec::new();
        for entry in fs::read_dir(&self.folder)? {
            let path = entry?.path();
            if writer_of(&path).is_some() {
                let age = fs::metadata(&path).and_then(|file| file.modified());
                files.push((age.ok(), path));
            }
        }
        files.sort();
        let room = self.context.recorder.files.saturating_sub(1);
        let many = files.len().saturating_sub(room);
        for (_, path) in files.into_iter().take(many) {
            fs::remove_file(&path)?;
        }
        Ok(())
    }

    fn report_written(
        &self,
        recording: &FrozenRecording,
        head: &IncidentHead,
        path: &Path,
    ) -> Recorded {
        info!("incident written: {}", path.display());
        let cycles = head.last_cycle.saturating_sub(head.first_cycle) + 1;
        self.tell(
            recording.trigger.cycle,
            EventKind::IncidentWritten {
                reason: head.reason.clone(),
                command: head.net,
                file: events::event_text(&path.display().to_string()),
                span_ms: cycles * head.period_ns / 1_000_000,
                others: head.others,
            },
        );
        RecordingState::Written {
            file: path.display().to_string(),
        }
    }

    fn report_failure(&self, error: &io::Error) -> Recorded {
        let why = format!("{}: {error}", self.folder.display());
        warn!("an incident was not written: {why}");
        let why = events::event_text(&why);
        self.tell(0, EventKind::IncidentLost { why: why.clone() });
        RecordingState::Lost { why }
    }

    fn tell(&self, cycle: u64, what: EventKind) {
        if let Some(log) = &self.log {
            log.tell_in((cycle != 0).then_some(cycle), what);
        }
    }
}
