//! Reads the file of a cell and the files that it names. Run at start-up.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rcc_core::message::{DEVICES_MAX, SET_POINTS};
use rcc_core::unit::Unit;

use super::clock;
use super::{CellConfig, ExecutorConfig, RealTime, SimulatorConfig, SupervisionConfig};
use crate::access;
use crate::base;
use crate::codes;
use crate::device::{DeviceConfig, channels};
use crate::diagnostic::{Faults, Span};
use crate::driver::{DriverConfig, DriverNeed, DriverProgram};
use crate::file::{self, SourceFile};
use crate::file_kind::FileKind;
use crate::link;
use crate::ports::{self, PortNumbers};
use crate::reader::{CELL_NAME, ConfigReader, DEVICE_NAME, Fields, QuantityRange, error};
use crate::recorder;
use crate::robot::{self, RobotConfig};
use crate::workspace;
use crate::yaml::{Entry, Node, ShortText, Value};

pub const KEYS: [&str; 12] = [
    "cell",
    "period",
    "stale_after",
    "clock",
    "executor",
    "recorder",
    "supervision",
    "access",
    "link",
    "ports",
    "simulators",
    "devices",
];
pub const EXECUTOR_KEYS: [&str; 5] = ["priority", "core", "late_in_a_row_max", "rt", "budget"];
pub const SUPERVISION_KEYS: [&str; 4] = ["restarts", "within", "stop_timeout", "watchdog"];
pub const SIMULATOR_KEYS: [&str; 3] = ["program", "arguments", "device"];
/// A key of older files, and its remedy.
const CONTROL: (&str, &str) = (
    "control",
    "remove this line, and the port that only it uses: a simulator with `device` has its control port in the cell's folder",
);
pub const DRIVER_KEYS: [&str; 3] = ["program", "arguments", "needs"];
pub const DEVICE_KEYS: [&str; 9] = [
    "driver",
    "robot",
    "settings",
    "channels",
    "first_tolerance",
    "base",
    "workspace",
    "command_timeout",
    "delay",
];

const MS: u64 = 1_000_000;
/// Above 100 % nets are admitted that cannot keep their period; only the rule about late cycles in a row ends them.
const BUDGET_MAX: f64 = 100.0;
const PERIOD_NS: [u64; 2] = [MS / 10, 1000 * MS];
const STALE_AFTER_NS: u64 = 50 * MS;
const STALE_AFTER_NS_MAX: u64 = 10_000 * MS;
const COMMAND_TIMEOUT_NS: u64 = 50 * MS;
const COMMAND_TIMEOUT_NS_MAX: u64 = 10_000 * MS;
const DELAY_NS: u64 = 10 * MS;
const DELAY_NS_MAX: u64 = 12_000 * MS;
/// The remaining set-points are reserved for an executor that is early or a driver that is late.
const DELAY_PERIODS_MAX: u64 = SET_POINTS as u64 - 4;
const FIRST_TOLERANCE_RAD: f64 = std::f64::consts::PI / 180.0 * 0.1;
/// The same for linear axes.
const FIRST_TOLERANCE_M: f64 = 1e-3;
const FIRST_TOLERANCE_M_MAX: f64 = 1e-2;
const FIRST_TOLERANCE_RAD_MAX: f64 = std::f64::consts::PI / 180.0;
/// Far beyond any machine; a missing core is detected when the thread is bound.
const CORE_MAX: i64 = 4095;

/// More restarts than this in a row hide a fault.
const RESTARTS_MAX: i64 = 1000;
const WITHIN_NS: [u64; 2] = [1000 * MS, 3_600_000 * MS];
const STOP_TIMEOUT_NS: [u64; 2] = [100 * MS, 60_000 * MS];
/// A shorter time would kill processes of a machine that is merely busy.
const WATCHDOG_NS: [u64; 2] = [500 * MS, 60_000 * MS];

/// State of reading besides the tree.
struct CellFileReader<'a> {
    reader: ConfigReader,
    base: &'a Path,
    ports: BTreeMap<String, u16>,
    period_ns: u64,
    /// Robots already read, by file; `None` if the file is faulty.
    robots: BTreeMap<PathBuf, Option<RobotConfig>>,
    /// Faults of the robots' files.
    others: Vec<Faults>,
}

/// Reads the text of a cell's file.
pub(super) fn cell(
    file: &SourceFile,
    base: &Path,
    numbers: PortNumbers<'_>,
) -> Result<CellConfig, Faults> {
    let (root, mut reader) = file::tree(file)?;
    let ports = ports::numbers(&mut reader, root.get("ports"), numbers);
    let mut reading = CellFileReader {
        reader,
        base,
        ports,
        period_ns: MS,
        robots: BTreeMap::new(),
        others: Vec::new(),
    };
    let cell = reading.cell(&root, PathBuf::from(&file.name));
    let own = file.faults(reading.reader);
    let mut all = reading.others.into_iter();
    let faults = match (own, all.next()) {
        (Err(mut own), other) => {
            other
                .into_iter()
                .chain(all)
                .for_each(|more| own.append(more));
            Some(own)
        }
        (Ok(()), Some(mut first)) => {
            all.for_each(|more| first.append(more));
            Some(first)
        }
        (Ok(()), None) => None,
    };
    match (cell, faults) {
        (Some(cell), None) => Ok(cell),
        (_, Some(faults)) => Err(faults),
        // Unreachable: a reader that returns no value has reported a fault. An empty list is still a refusal.
        (None, None) => Err(Faults::new(&*file.name, &*file.text, Vec::new())),
    }
}

impl CellFileReader<'_> {
    fn cell(&mut self, root: &Node, source: PathBuf) -> Option<CellConfig> {
        self.reader.expect_kind(root, FileKind::Cell)?;
        let fields = self.reader.fields(root, root.span, "a cell", &KEYS)?;
        let name = self.reader.require(&fields, "cell");
        let name = name.and_then(|node| self.name(node, "a cell"));
        let period_ns = self.reader.require(&fields, "period").and_then(|node| {
            let [least, most] = PERIOD_NS;
            self.reader.nanoseconds(node, "period", least, most)
        });
        // With a faulty period, check the rest against the default one.
        self.period_ns = period_ns.unwrap_or(MS);
        let stale_after_ns =
            self.timeout(&fields, "stale_after", STALE_AFTER_NS, STALE_AFTER_NS_MAX);
        let executor = self.executor(&fields);
        let recorder = recorder::read(&mut self.reader, &fields, self.base);
        let supervision = self.supervision(&fields);
        let access = access::read(&mut self.reader, &fields, self.base, &self.ports);
        let link = link::read(&mut self.reader, &fields, &self.ports);
        let simulators = self.simulators(&fields);
        let devices = self.devices(&fields);
        let clock = clock::read(&mut self.reader, &fields, self.period_ns);
        self.check_simulators(&fields);
        Some(CellConfig {
            name: name?,
            period_ns: period_ns?,
            stale_after_ns: stale_after_ns?,
            clock: clock?,
            executor: executor?,
            recorder: recorder?,
            supervision: supervision?,
            access: access?,
            link: link?,
            devices: devices?,
            simulators: simulators?,
            ports: self.ports.clone(),
            source,
        })
    }

    fn name(&mut self, node: &Node, what: &str) -> Option<String> {
        let form = if what == "a cell" {
            CELL_NAME
        } else {
            DEVICE_NAME
        };
        let text = self.reader.text(node, &format!("the name of {what}"))?;
        self.reader.name(text, node.span, what, form)
    }

    /// Reads a maximum age: at least two periods, since otherwise data would be stale between two cycles.
    fn timeout(&mut self, fields: &Fields<'_>, key: &str, usual: u64, most: u64) -> Option<u64> {
        match fields.get(key) {
            Some(node) => {
                let what = format!("{key} (two periods or more)");
                self.reader
                    .nanoseconds(node, &what, 2 * self.period_ns, most)
            }
            None => Some(usual.max(3 * self.period_ns)),
        }
    }

    fn executor(&mut self, cell: &Fields<'_>) -> Option<ExecutorConfig> {
        let mut executor = ExecutorConfig::default();
        let Some(entry) = cell.entry("executor") else {
            return Some(executor);
        };
        let (node, place) = (&entry.value, entry.key.span);
        let fields = self
            .reader
            .fields(node, place, "the executor", &EXECUTOR_KEYS)?;
        let mut whole = |key, least, most| {
            let node = fields.get(key)?;
            self.reader.integer(node, key, least, most)
        };
        if let Some(priority) = whole("priority", 1, 99) {
            executor.priority = u8::try_from(priority).ok()?;
        }
        if let Some(core) = whole("core", 0, CORE_MAX) {
            executor.core = usize::try_from(core).ok();
        }
        if let Some(late) = whole("late_in_a_row_max", 0, i64::from(u32::MAX)) {
            executor.late_in_a_row_max = u32::try_from(late).ok()?;
        }
        if let Some(node) = fields.get("budget") {
            let wanted = QuantityRange {
                unit: Unit::ONE,
                least: 0.01,
                most: BUDGET_MAX,
            };
            let share = self.reader.quantity(node, "budget", wanted)?;
            executor.budget_permille = (share * 1e3).round() as u32;
        }
        if let Some(node) = fields.get("rt") {
            let words = [
                ("best-effort", RealTime::BestEffort),
                ("required", RealTime::Required),
            ];
            executor.rt = self.reader.keyword(node, "kind of real time", &words)?;
        }
        Some(executor)
    }

    fn supervision(&mut self, cell: &Fields<'_>) -> Option<SupervisionConfig> {
        let mut supervision = SupervisionConfig::default();
        let Some(entry) = cell.entry("supervision") else {
            return Some(supervision);
        };
        let (node, place) = (&entry.value, entry.key.span);
        let fields = self
            .reader
            .fields(node, place, "the supervision", &SUPERVISION_KEYS)?;
        let restarts = fields.get("restarts");
        let restarts = restarts.map(|node| self.reader.integer(node, "restarts", 0, RESTARTS_MAX));
        let times = [
            ("within", WITHIN_NS, &mut supervision.within_ns),
            (
                "stop_timeout",
                STOP_TIMEOUT_NS,
                &mut supervision.stop_timeout_ns,
            ),
            ("watchdog", WATCHDOG_NS, &mut supervision.watchdog_ns),
        ];
        // Read all keys before returning, so that all faults are reported together.
        let mut valid = true;
        for (key, [least, most], time) in times {
            if let Some(node) = fields.get(key) {
                let read = self.reader.nanoseconds(node, key, least, most);
                valid &= read.is_some();
                *time = read.unwrap_or(*time);
            }
        }
        if let Some(restarts) = restarts {
            supervision.restarts = u32::try_from(restarts?).ok()?;
        }
        if !valid {
            return None;
        }
        Some(supervision)
    }

    fn simulators(&mut self, cell: &Fields<'_>) -> Option<Vec<SimulatorConfig>> {
        let Some(node) = cell.get("simulators") else {
            return Some(Vec::new());
        };
        let entries = self.reader.entries(node, "simulators")?;
        let simulators = entries.iter().filter_map(|entry| self.simulator(entry));
        Some(simulators.collect())
    }

    fn simulator(&mut self, Entry { key, value }: &Entry) -> Option<SimulatorConfig> {
        let reader = &mut self.reader;
        let name = reader.key_name(key, "a simulator", DEVICE_NAME);
        let fields = reader.fields_or(value, key.span, "a simulator", &SIMULATOR_KEYS, CONTROL)?;
        let program = reader.require(&fields, "program");
        let program = program.and_then(|node| Some((reader.text(node, "program")?, node.span)));
        let arguments = self.arguments(&fields);
        let device = match fields.get("device") {
            Some(node) => Some(self.name(node, "a device")?),
            None => None,
        };
        let (program, span) = program?;
        Some(SimulatorConfig {
            name: name?,
            program: ports::substitute(&mut self.reader, program, span, &self.ports)?,
            arguments,
            device,
        })
    }

    /// Checks that each simulator names a device of this cell.
    fn check_simulators(&mut self, cell: &Fields<'_>) {
        let names = |key: &str| -> Vec<ShortText> {
            let entries = cell.get(key).map(|node| &node.value);
            match entries {
                Some(Value::Map(entries)) => {
                    entries.iter().map(|entry| entry.key.name.clone()).collect()
                }
                _ => Vec::new(),
            }
        };
        let devices = names("devices");
        let Some(Value::Map(simulators)) = cell.get("simulators").map(|node| &node.value) else {
            return;
        };
        for simulator in simulators {
            if let Some(node) = simulator.value.get("device")
                && let Value::Text(device) = &node.value
                && !devices.contains(device)
            {
                let message = format!("this cell has no device `{device}`");
                let fault = error(codes::UNKNOWN_DEVICE, node.span, message);
                self.reader
                    .report(fault.help(format!("the devices are: {}", devices.join(", "))));
            }
        }
    }

    fn arguments(&mut self, fields: &Fields<'_>) -> Vec<String> {
        let list = fields.get("arguments");
        let list = list.and_then(|node| self.reader.list(node, "arguments"));
        let list = list.unwrap_or_default().iter();
        list.filter_map(|node| self.argument(node)).collect()
    }

    /// Reads a text or an integer; other numbers would not be passed on exactly as written.
    fn argument(&mut self, node: &Node) -> Option<String> {
        match &node.value {
            Value::Int(number) => Some(number.to_string()),
            Value::Text(text) => ports::substitute(&mut self.reader, text, node.span, &self.ports),
            _ => {
                self.reader
                    .wrong_type(node, "an argument", "text (put it in quotes)");
                None
            }
        }
    }

    fn devices(&mut self, cell: &Fields<'_>) -> Option<Vec<DeviceConfig>> {
        let node = self.reader.require(cell, "devices")?;
        let entries = self.reader.entries(node, "devices")?;
        let places: Vec<Span> = entries.iter().map(|entry| entry.key.span).collect();
        self.reader
            .at_most(DEVICES_MAX, "devices in one cell", &places);
        let devices = entries.iter().filter_map(|entry| self.device(entry));
        Some(devices.collect())
    }

    fn device(&mut self, Entry { key, value }: &Entry) -> Option<DeviceConfig> {
        let name = self.reader.key_name(key, "a device", DEVICE_NAME);
        let fields = self
            .reader
            .fields(value, key.span, "a device", &DEVICE_KEYS)?;
        let driver = self.reader.require(&fields, "driver");
        let driver = driver.and_then(|node| self.driver(node));
        let robot = match fields.get("robot") {
            Some(node) => self.robot(node).map(Some),
            None => {
                self.refuse_keys_of_arms(&fields);
                Some(None)
            }
        };
        let settings = self.settings(&fields);
        let channels = match fields.get("channels") {
            Some(node) => channels(&mut self.reader, node),
            None => Some(Vec::new()),
        };
        let linear = robot
            .as_ref()
            .and_then(Option::as_ref)
            .is_some_and(|robot| robot.arm.is_linear());
        let tolerance = self.first_tolerance(&fields, linear);
        let base = base::read(&mut self.reader, &fields);
        let workspace = workspace::read(&mut self.reader, &fields);
        let timeout = self.timeout(
            &fields,
            "command_timeout",
            COMMAND_TIMEOUT_NS,
            COMMAND_TIMEOUT_NS_MAX,
        );
        let delay = self.delay(&fields);
        Some(DeviceConfig {
            name: name?,
            driver: driver?,
            folder: self.base.to_owned(),
            robot: robot?,
            settings: settings?,
            channels: channels?,
            first_tolerance_rad: tolerance?,
            base: base?,
            workspace: workspace?,
            command_timeout_ns: timeout?,
            delay_ns: delay?,
        })
    }

    /// Reads the name of one of RCC's own drivers, or the program of another one.
    fn driver(&mut self, node: &Node) -> Option<DriverConfig> {
        if !matches!(node.value, Value::Map(_)) {
            return self.name(node, "a driver").map(DriverConfig::Name);
        }
        let reader = &mut self.reader;
        let fields = reader.fields(node, node.span, "a driver", &DRIVER_KEYS)?;
        let program = reader.require(&fields, "program");
        let program = program.and_then(|node| reader.text(node, "program"));
        let needs = match fields.get("needs") {
            Some(node) => reader.list(node, "needs")?,
            None => &[],
        };
        let needs: Vec<DriverNeed> = needs.iter().filter_map(|node| self.need(node)).collect();
        let arguments = self.arguments(&fields);
        Some(DriverConfig::Program(DriverProgram {
            program: program?.to_owned(),
            arguments,
            needs,
        }))
    }

    fn need(&mut self, node: &Node) -> Option<DriverNeed> {
        let text = self.reader.text(node, "a need of a driver")?;
        let need = DriverNeed::read(text);
        if need.is_none() {
            let message = format!("unknown need of a driver `{text}`");
            let help = format!(
                "known needs: `{}`, or a device file: `/dev/ttyUSB0`",
                DriverNeed::RAW_NETWORK
            );
            let fault = error(codes::UNKNOWN_KIND, node.span, message);
            self.reader.report(fault.help(&help));
        }
        need
    }

    fn settings(&mut self, device: &Fields<'_>) -> Option<serde_json::Value> {
        let Some(node) = device.get("settings") else {
            return Some(serde_json::Value::Object(serde_json::Map::new()));
        };
        self.reader.entries(node, "settings")?;
        self.json(node)
    }

    fn first_tolerance(&mut self, device: &Fields<'_>, linear: bool) -> Option<f64> {
        let [default, most] = match linear {
            true => [FIRST_TOLERANCE_M, FIRST_TOLERANCE_M_MAX],
            false => [FIRST_TOLERANCE_RAD, FIRST_TOLERANCE_RAD_MAX],
        };
        let Some(node) = device.get("first_tolerance") else {
            return Some(default);
        };
        let wanted = QuantityRange {
            most,
            ..QuantityRange::positive(Unit::of_joints(linear, 0))
        };
        self.reader.quantity(node, "first_tolerance", wanted)
    }

    fn refuse_keys_of_arms(&mut self, fields: &Fields<'_>) {
        for key in ["first_tolerance", "base", "workspace", "delay"] {
            if let Some(entry) = fields.entry(key) {
                let message = format!("`{key}` has no meaning for a device without a robot");
                let help = "remove it, or name the robot's file: `robot: …`";
                let fault = error(codes::KEY_OF_OTHER_KIND, entry.key.span, message);
                self.reader.report(fault.help(help));
            }
        }
    }

    fn delay(&mut self, fields: &Fields<'_>) -> Option<u64> {
        let most = DELAY_PERIODS_MAX * self.period_ns;
        let Some(node) = fields.get("delay") else {
            return Some(DELAY_NS.min(most));
        };
        let delay = self.reader.nanoseconds(node, "delay", 0, DELAY_NS_MAX)?;
        if delay <= most {
            return Some(delay);
        }
        let message = format!("the delay is longer than {DELAY_PERIODS_MAX} periods");
        let label = format!("at most {} ms", most as f64 / MS as f64);
        let help = format!(
            "a driver finds the last {SET_POINTS} set-points; choose a shorter delay or a longer period"
        );
        let fault = error(codes::DELAY_TOO_LONG, node.span, message);
        self.reader.report(fault.label(label).help(help));
        None
    }

    fn robot(&mut self, node: &Node) -> Option<RobotConfig> {
        let name = self.reader.text(node, "robot")?;
        let path = self.base.join(name);
        if let Some(known) = self.robots.get(&path) {
            return known.clone();
        }
        let robot = self.robot_file(node, name, &path);
        self.robots.insert(path, robot.clone());
        robot
    }

    fn robot_file(&mut self, node: &Node, source: &str, path: &Path) -> Option<RobotConfig> {
        let text = match file::text(path) {
            Ok(text) => text,
            Err(cause) => {
                let mut fault = file::unreadable(path, &cause);
                fault.place = Some(node.span);
                self.reader.report(fault);
                return None;
            }
        };
        let name = path.display().to_string();
        let file = SourceFile { name, text };
        let result = file::tree(&file).and_then(|(root, mut reader)| {
            let robot = robot::read(&mut reader, &root, source);
            file.faults(reader).map(|()| robot)
        });
        result.unwrap_or_else(|faults| {
            self.others.push(faults);
            None
        })
    }

    /// Converts settings for the driver: without positions, with ports substituted.
    fn json(&mut self, node: &Node) -> Option<serde_json::Value> {
        use serde_json::Value as Json;
        match &node.value {
            Value::Text(text) => {
                let text = ports::substitute(&mut self.reader, text, node.span, &self.ports)?;
                Some(Json::String(text))
            }
            Value::List(nodes) => nodes.iter().map(|node| self.json(node)).collect(),
            Value::Map(entries) => {
                let pairs = entries
                    .iter()
                    .map(|Entry { key, value }| Some((key.name.to_string(), self.json(value)?)));
                Some(Json::Object(pairs.collect::<Option<_>>()?))
            }
            _ => Some(node.to_json()),
        }
    }
}
