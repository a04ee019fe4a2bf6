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
use rcc_engine::incident::{self, COMMAND_FILE_MAX, EXTENSION, FORMAT, Head, Overview, Parts};
use rcc_engine::net::Origin;
use rcc_engine::record::{Reason, RecorderHelper, Recording};
use rcc_ipc::control::Recorded;
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::{Cell, Life, monotonic_ns};
use rcc_process::Helper;
use tracing::{info, warn};

/// How often a frozen recording is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// How often plans are looked through for those that nobody needs any more.
const FORGET_EVERY: Duration = Duration::from_secs(1);
/// Plans of commands that were unloaded are kept as long as a recording may have them, and no more than so many.
const GONE_MAX: usize = 256;

/// A file that is being written has this extension.
const HALF: &str = "half";
/// What became of so many recordings is remembered.
const RECORDINGS_MAX: usize = 64;

/// The life of the executor that wrote the incident file of this name, and whether it is a half-written one; nothing for
/// files that are none of ours.
fn writer_of(path: &Path) -> Option<(Life, bool)> {
    let half = match path.extension()?.to_str()? {
        EXTENSION => false,
        HALF => true,
        _ => return None,
    };
    // As `Scribe::write` names them: EXECUTOR-CYCLE-REASON.
    let mut parts = path.file_stem()?.to_str()?.splitn(3, '-');
    let (executor, cycle, reason) = (parts.next()?, parts.next()?, parts.next()?);
    let digits = executor.len() == 16 && cycle.parse::<u64>().is_ok();
    let known = digits && ["fault", "late", "request"].contains(&reason);
    let executor = u64::from_str_radix(executor, 16).ok().filter(|_| known)?;
    Some((Life::from_incarnation(executor), half))
}

/// What became of the last recordings: written by the thread that writes files, read by the intake thread.
#[derive(Clone, Debug, Default)]
pub struct Recordings(Arc<Mutex<VecDeque<(u64, Recorded)>>>);

impl Recordings {
    fn add(&self, last_cycle: u64, recorded: Recorded) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.push_back((last_cycle, recorded));
        if all.len() > RECORDINGS_MAX {
            all.pop_front();
        }
    }

    /// What became of the recording that was frozen by a request in this cycle: the first that goes beyond it.
    #[must_use]
    pub fn of(&self, cycle: u64) -> Recorded {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = all.iter().find(|(last_cycle, _)| *last_cycle >= cycle);
        found.map_or(Recorded::NotYet, |(_, recorded)| recorded.clone())
    }
}

/// A file whose writer shows that it lives with each piece: a disk may be slow.
struct Turning<'a> {
    file: &'a File,
    helper: &'a Helper,
}

impl Write for Turning<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.helper.turn();
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// A command that is about to be ready or to start: its id, and what its net begins from.
pub type Made = (u64, Origin);

/// What an incident says about the cell.
#[derive(Clone, Debug)]
pub struct About {
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
struct Kept {
    id: u64,
    origin: Origin,
    /// The file that names it, as the loader wrote it; nobody here reads it.
    file: Option<Vec<u8>>,
    /// Since when its net does not exist any more.
    gone: Option<Instant>,
}

/// Everything that the thread owns.
#[derive(Debug)]
pub struct Scribe {
    about: About,
    folder: PathBuf,
    helper: RecorderHelper,
    made: Receiver<Made>,
    kept: VecDeque<Kept>,
    forgot_at: Instant,
    log: Option<Recorder>,
    recordings: Recordings,
}

impl Scribe {
    /// Writes what comes through `helper`; whoever makes commands tells them to the sender.
    pub fn new(about: About, helper: RecorderHelper) -> (Scribe, Sender<Made>, Recordings) {
        let (sender, made) = channel();
        let folder = about.recorder.folder.clone();
        // Of several cells that share a folder each has its own in it.
        let folder = folder.map(|folder| folder.join(about.cell.name()));
        let folder = folder.unwrap_or_else(|| about.cell.incidents_dir());
        let scribe = Scribe {
            about,
            folder,
            helper,
            made,
            forgot_at: Instant::now(),
            kept: VecDeque::new(),
            log: None,
            recordings: Recordings::default(),
        };
        let recordings = scribe.recordings.clone();
        (scribe, sender, recordings)
    }

    /// Writes what happens to the cell's event log, too.
    #[must_use]
    pub fn recording(mut self, log: Recorder) -> Scribe {
        self.log = Some(log);
        self
    }

    /// Works until it is asked to end; what was frozen by then is still written.
    pub fn run(mut self, helper: &Helper) {
        self.remove_halves();
        while !helper.is_over() {
            helper.turn();
            match self.made.recv_timeout(LOOK_EVERY) {
                Ok(made) => self.keep(made),
                Err(RecvTimeoutError::Timeout) => {}
                // Nobody makes commands any more: the executor ends.
                Err(RecvTimeoutError::Disconnected) => std::thread::sleep(LOOK_EVERY),
            }
            if self.forgot_at.elapsed() > FORGET_EVERY {
                self.forgot_at = Instant::now();
                self.forget();
            }
            self.look(helper);
        }
        self.look(helper);
    }

    fn keep(&mut self, (id, origin): Made) {
        // Of a net that was prepared anew before it started, what it begins from now.
        if let Some(kept) = self.kept.iter_mut().find(|kept| kept.id == id) {
            kept.origin = origin;
            return;
        }
        let file = self.command_file(id);
        self.kept.push_back(Kept {
            id,
            origin,
            file,
            gone: None,
        });
    }

    fn command_file(&self, id: u64) -> Option<Vec<u8>> {
        let folder = events::digits(self.about.incarnation);
        let path = self.about.cell.commands_dir().join(folder);
        let path = path.join(format!("{id}.json"));
        rcc_os::file::read(&path, COMMAND_FILE_MAX as u64).ok()
    }

    /// Forgets plans that no recording can have any more, and the oldest of too many.
    fn forget(&mut self) {
        let span = Duration::from_nanos(self.about.recorder.span_ns) * 2 + Duration::from_secs(1);
        for kept in &mut self.kept {
            // The net shares its plan: when this one is the last, there is no net.
            if kept.gone.is_none() && Arc::strong_count(&kept.origin.data) == 1 {
                kept.gone = Some(Instant::now());
            }
        }
        let old = |kept: &Kept| kept.gone.is_some_and(|gone| gone.elapsed() > span);
        self.kept.retain(|kept| !old(kept));
        let gone = self.kept.iter().filter(|kept| kept.gone.is_some()).count();
        let mut many = gone.saturating_sub(GONE_MAX);
        self.kept.retain(|kept| {
            let goes = many > 0 && kept.gone.is_some();
            many -= usize::from(goes);
            !goes
        });
    }

    fn look(&mut self, helper: &Helper) {
        while let Ok(recording) = self.helper.recordings.pop() {
            // Plans of nets that were made ready meanwhile.
            while let Ok(made) = self.made.try_recv() {
                self.keep(made);
            }
            let overview = incident::overview(&recording.ring);
            let head = self.head(&recording, &overview);
            let last_cycle = head.last_cycle;
            let recorded = match self.write(&recording, head.clone(), helper) {
                Ok(path) => self.written(&recording, &head, &path),
                Err(error) => self.lost(&error),
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

    fn head(&self, recording: &Recording, overview: &Overview) -> Head {
        let trigger = &recording.trigger;
        let (reason, net, fault) = match trigger.reason {
            Reason::Fault { id, fault } => {
                let words = FaultCode::from_number(fault.code).name();
                let device = self.about.devices.get(fault.device as usize);
                let of = device.map_or_else(String::new, |device| format!(": {device}"));
                ("fault", Some(id), Some(format!("{words}{of}")))
            }
            Reason::Late => ("late", None, None),
            Reason::Request => ("request", None, None),
        };
        // Those whose plan is here are found out when the file is written.
        let ago = Duration::from_nanos(monotonic_ns().saturating_sub(trigger.stamp_ns));
        let missing = |id: &&u64| !self.kept.iter().any(|kept| kept.id == **id);
        Head {
            format: FORMAT,
            build: concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned(),
            layout: incident::layout(),
            catalogue: events::digits(primitives::fingerprint()),
            configuration: events::digits(self.about.configuration),
            cell: self.about.cell.name().to_owned(),
            config: self.about.config.clone(),
            executor: events::digits(self.about.incarnation),
            period_ns: self.about.period_ns,
            devices: self.about.devices.clone(),
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
            ..Head::default()
        }
    }

    /// Writes the file whole or not at all.
    fn write(&self, recording: &Recording, head: Head, helper: &Helper) -> io::Result<PathBuf> {
        let mut folder = DirBuilder::new();
        folder.recursive(true).mode(0o700).create(&self.folder)?;
        self.link()?;
        self.make_room()?;
        let wanted = |kept: &&Kept| head.nets.contains(&kept.id);
        let kept: Vec<&Kept> = self.kept.iter().filter(wanted).collect();
        let files: Vec<(u64, &[u8])> = kept
            .iter()
            .filter_map(|kept| Some((kept.id, kept.file.as_deref()?)))
            .collect();
        let nets: Vec<(u64, &Origin)> = kept.iter().map(|kept| (kept.id, &kept.origin)).collect();
        let parts = Parts {
            files: &files,
            models: &self.about.models,
            nets: &nets,
            ring: &recording.ring,
        };
        let name = format!("{}-{}-{}", head.executor, head.cycle, head.reason);
        let path = self.folder.join(name).with_extension(EXTENSION);
        let half = path.with_extension(HALF);
        let mut options = OpenOptions::new();
        options.write(true).create(true).truncate(true).mode(0o600);
        let written = options.open(&half).and_then(|file| {
            incident::write(
                Turning {
                    file: &file,
                    helper,
                },
                head,
                &parts,
            )?;
            file.sync_all()?;
            fs::rename(&half, &path)
        });
        if let Err(error) = written {
            // What is there of it is of no use; if it cannot be removed, it counts among the files.
            let _ = fs::remove_file(&half);
            return Err(error);
        }
        File::open(&self.folder)?.sync_all()?;
        Ok(path)
    }

    /// The runtime folder says where the files are.
    fn link(&self) -> io::Result<()> {
        let link = self.about.cell.incidents_dir();
        if self.folder == link || link.exists() {
            return Ok(());
        }
        std::os::unix::fs::symlink(&self.folder, link)
    }

    /// Removes half-written files whose writer is dead: an executor that was killed while it wrote.
    fn remove_halves(&self) {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        for path in entries.map(|entry| entry.path()) {
            let dead =
                writer_of(&path).is_some_and(|(life, half)| half && life.liveness().is_dead());
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
        let room = self.about.recorder.files.saturating_sub(1);
        let many = files.len().saturating_sub(room);
        for (_, path) in files.into_iter().take(many) {
            fs::remove_file(&path)?;
        }
        Ok(())
    }

    fn written(&self, recording: &Recording, head: &Head, path: &Path) -> Recorded {
        info!("incident written: {}", path.display());
        let cycles = head.last_cycle.saturating_sub(head.first_cycle) + 1;
        self.tell(
            recording.trigger.cycle,
            Kind::IncidentWritten {
                reason: head.reason.clone(),
                command: head.net,
                file: events::text(&path.display().to_string()),
                span_ms: cycles * head.period_ns / 1_000_000,
                others: head.others,
            },
        );
        Recorded::Written {
            file: path.display().to_string(),
        }
    }

    fn lost(&self, error: &io::Error) -> Recorded {
        let why = format!("{}: {error}", self.folder.display());
        warn!("an incident was not written: {why}");
        let why = events::text(&why);
        self.tell(0, Kind::IncidentLost { why: why.clone() });
        Recorded::Lost { why }
    }

    fn tell(&self, cycle: u64, what: Kind) {
        if let Some(log) = &self.log {
            log.tell_in((cycle != 0).then_some(cycle), what);
        }
    }
}
