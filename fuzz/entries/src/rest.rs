//! Target `rest`: arbitrary methods, addresses and bodies to the loader's REST interface, with a fake executor whose
//! boards and answers are arbitrary. Every answer must be one of the interface. Run by the thread of the target, the
//! loader's runtime, and the thread of the fake executor.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use arbitrary::{Arbitrary, Result, Unstructured};
use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{Request, StatusCode};
use bytemuck::{Zeroable, bytes_of_mut};
use rcc_api::codes;
use rcc_core::message::{CommandState, CycleStatus, DeviceState, MAGIC, Tables};
use rcc_core::timing::CycleTiming;
use rcc_ipc::{BoardWriter, Cell, Server, Session};
use rcc_loader::server::executor::ExecutorLink;
use rcc_loader::server::peer::ClientPeer;
use rcc_loader::server::routes::router;
use rcc_loader::server::service::Service;
use rcc_process::Helpers;
use rcc_protocol::control::{
    Answer, CONTROL, Call, NetValues, READ_ELEMENTS_MAX, STATUS, TABLES, TIMING,
};
use rcc_protocol::{Configuration, Role, wire};
use tower_service::Service as _;

use crate::shipped::shipped;

/// Maximum number of requests per input.
const REQUESTS: usize = 3;
/// Maximum size of an answer, bytes; a longer one is a bug.
const ANSWER_MAX: usize = 16 << 20;
/// Number of inputs after which the files of old commands are removed.
const MAINTAIN_EVERY: u32 = 5_000;

/// State of the fake executor: contents of its boards, and its next answers.
struct FakeExecutorState {
    tables: Box<Tables>,
    status: CycleStatus,
    timing: Box<CycleTiming>,
    /// Answers to give instead of correct ones.
    answers: VecDeque<Vec<u8>>,
    /// True if the boards do not show this state yet.
    changed: bool,
    next_id: u64,
    /// Set to end the thread.
    over: bool,
}

struct RestHarness {
    runtime: tokio::runtime::Runtime,
    router: Router,
    service: Arc<Service>,
    fake: Arc<Mutex<FakeExecutorState>>,
    inputs: u32,
    executor: JoinHandle<()>,
    folder: PathBuf,
}

static HARNESS: Mutex<Option<RestHarness>> = Mutex::new(None);

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn unwrap_or_panic<T, E: std::fmt::Display>(result: std::result::Result<T, E>) -> T {
    result.unwrap_or_else(|error| panic!("{error}"))
}

/// Creates a cell in memory. Cells of targets that have ended are removed first, because libFuzzer ends without
/// cleaning up.
fn new_cell() -> Cell {
    let memory = Path::new("/dev/shm");
    let parent = if memory.is_dir() {
        memory.to_owned()
    } else {
        std::env::temp_dir()
    };
    let folders: Vec<PathBuf> = std::fs::read_dir(&parent)
        .into_iter()
        .flatten()
        .flatten()
        .map(|e| e.path())
        .collect();
    for folder in folders {
        let name = folder
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let Some(pid) = name.strip_prefix("rcc-fuzz-") else {
            continue;
        };
        if !Path::new("/proc").join(pid).exists() {
            remove_cell(&folder);
        }
    }
    unwrap_or_panic(Cell::at(
        "fuzz",
        &parent.join(format!("rcc-fuzz-{}", std::process::id())),
    ))
}

/// Stops everything that the first input set up, and removes its files.
pub fn tear_down() {
    let Some(harness) = locked(&HARNESS).take() else {
        return;
    };
    let RestHarness {
        runtime,
        router,
        service,
        fake,
        executor,
        folder,
        ..
    } = harness;
    // Pending compilations finish first.
    drop((router, runtime, service));
    locked(&fake).over = true;
    assert!(executor.join().is_ok(), "the executor does not panic");
    remove_cell(&folder);
}

fn remove_cell(folder: &Path) {
    if let Ok(cell) = Cell::at("fuzz", folder) {
        // An error is ignored: the next run removes the rest.
        let _ = rcc_ipc::clean::remove_cell(&cell);
    }
    let _ = std::fs::remove_dir_all(folder);
}

fn set_up() -> RestHarness {
    let cell = new_cell();
    let session = unwrap_or_panic(Session::join(&cell, Role::Executor, "exec"));
    let server = unwrap_or_panic(session.serve(CONTROL));
    let status = unwrap_or_panic(session.create_board::<CycleStatus>(STATUS));
    let tables = unwrap_or_panic(session.create_board::<Tables>(TABLES));
    let timing = unwrap_or_panic(session.create_board::<CycleTiming>(TIMING));
    let helpers = unwrap_or_panic(
        session.create_board::<rcc_core::helper::HelperTable>(rcc_protocol::control::HELPERS),
    );
    let announcement = session
        .announcement()
        .configured(Configuration::new(shipped().cell.identity()))
        .service(CONTROL, server.service())
        .service(STATUS, status.service())
        .service(TABLES, tables.service())
        .service(TIMING, timing.service())
        .service(rcc_protocol::control::HELPERS, helpers.service());
    let announced = unwrap_or_panic(cell.announce(&announcement));
    let fake = Arc::new(Mutex::new(FakeExecutorState {
        tables: bytemuck::zeroed_box(),
        status: CycleStatus::zeroed(),
        timing: bytemuck::zeroed_box(),
        answers: VecDeque::new(),
        changed: true,
        next_id: 0,
        over: false,
    }));
    let shared = Arc::clone(&fake);
    let executor = std::thread::spawn(move || {
        play_executor(&server, (status, tables, timing), &shared);
        drop((announced, helpers, server, session));
    });
    let loader = unwrap_or_panic(Session::join(&cell, Role::Loader, "loader"));
    let service = Arc::new(Service::new(
        ExecutorLink::new(loader),
        shipped().cell.clone(),
    ));
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build();
    let (runtime, router) = (
        unwrap_or_panic(runtime),
        unwrap_or_panic(router(Arc::clone(&service), &Helpers::default())),
    );
    let folder = cell.runtime_dir().to_owned();
    RestHarness {
        runtime,
        router,
        service,
        fake,
        inputs: 0,
        executor,
        folder,
    }
}

/// Runs the fake executor.
fn play_executor(
    server: &Server,
    boards: (
        BoardWriter<CycleStatus>,
        BoardWriter<Tables>,
        BoardWriter<CycleTiming>,
    ),
    fake: &Mutex<FakeExecutorState>,
) {
    let (mut status, mut tables, mut timing) = boards;
    loop {
        let mut now = locked(fake);
        if now.over {
            return;
        }
        if std::mem::take(&mut now.changed) {
            status.write(&now.status);
            tables.write(&now.tables);
            timing.write(&now.timing);
        }
        match server.poll() {
            Ok(Some(request)) => {
                let call = wire::decode::<Call>(request.bytes());
                let answer = match (now.answers.pop_front(), call) {
                    (Some(bytes), _) => bytes,
                    (None, Ok(call)) => unwrap_or_panic(wire::encode(&now.answer(&call))),
                    (None, Err(error)) => panic!("the loader sent a malformed call: {error}"),
                };
                tables.write(&now.tables);
                // The client may have given up.
                let _ = request.answer(&answer);
            }
            _ => {
                drop(now);
                std::thread::sleep(Duration::from_micros(100));
            }
        }
    }
}

impl FakeExecutorState {
    fn answer(&mut self, call: &Call) -> Answer {
        let (id, state) = match call {
            Call::Read { points, .. } => {
                let elements = points.iter().map(|point| point.width as usize);
                return Answer::Values(NetValues {
                    words: vec![0; elements.sum::<usize>().min(READ_ELEMENTS_MAX)],
                    ..NetValues::default()
                });
            }
            Call::Set { .. } | Call::Switch { .. } => return Answer::Done { cycle: 8 },
            Call::Reserve => {
                self.next_id += 1;
                if let Some(row) = self.tables.commands.iter_mut().find(|row| row.id == 0) {
                    (row.id, row.state) = (self.next_id, CommandState::Loading as u32);
                }
                return Answer::Reserved { id: self.next_id };
            }
            Call::Install { id, .. } => (id, CommandState::Ready),
            Call::Reject { id } => (id, CommandState::Rejected),
            Call::Start { id, .. } | Call::Cancel { id } => (id, CommandState::Running),
            Call::Abort { id } => (id, CommandState::Terminated),
            Call::Unload { id } => (id, CommandState::None),
            Call::Record => return Answer::Done { cycle: 8 },
            Call::Recorded { .. } => {
                return Answer::Recorded(rcc_protocol::control::RecordingState::Lost {
                    why: String::new(),
                });
            }
            Call::Acknowledge => return Answer::Done { cycle: 8 },
            Call::InstallRules { .. } => return Answer::RulesInstalled { first: 1, cycle: 8 },
            Call::Rules { .. } => return Answer::Rules(Vec::new()),
            Call::GrantLease { .. } => return Answer::Reserved { id: 3 },
            Call::RemoveRule { .. }
            | Call::RenewLease { .. }
            | Call::EndLease { .. }
            | Call::BindLease { .. } => return Answer::Done { cycle: 8 },
        };
        if let Some(row) = self.tables.commands.iter_mut().find(|row| row.id == *id) {
            row.state = state as u32;
        }
        Answer::Done { cycle: 8 }
    }
}

/// Derives the fake executor's state from the bytes, then sends some requests.
pub fn run(data: &[u8]) {
    let mut harness = locked(&HARNESS);
    let harness = harness.get_or_insert_with(set_up);
    let mut bytes = Unstructured::new(data);
    {
        let mut fake = locked(&harness.fake);
        prepare(&mut fake);
        // When the bytes run out, the rest stays unchanged.
        let _ = corrupt(&mut fake, &mut bytes);
        fake.changed = true;
    }
    harness.inputs += 1;
    if harness.inputs.is_multiple_of(MAINTAIN_EVERY) {
        harness.service.maintain();
    }
    for _ in 0..REQUESTS {
        if bytes.is_empty() {
            break;
        }
        if let Ok(Some(request)) = request(&mut bytes) {
            check_answer(harness, request);
        }
    }
}

/// Resets the fake executor to its initial state: two commands and the devices.
fn prepare(fake: &mut FakeExecutorState) {
    *fake.tables = Tables::zeroed();
    fake.tables.magic = MAGIC;
    fake.tables.cycle = 7;
    for (row, (id, state)) in fake
        .tables
        .commands
        .iter_mut()
        .zip([(5, CommandState::Ready), (6, CommandState::Terminated)])
    {
        (row.id, row.state) = (id, state as u32);
    }
    for device in fake.tables.devices.iter_mut().take(2) {
        (device.state, device.attached) = (DeviceState::Ready as u32, 1);
    }
    fake.status = CycleStatus {
        magic: MAGIC,
        cycle: 7,
        grants: 3,
        period_ns: 1_000_000,
        ..CycleStatus::zeroed()
    };
    fake.answers.clear();
    fake.next_id = 100;
}

fn corrupt(fake: &mut FakeExecutorState, bytes: &mut Unstructured<'_>) -> Result<()> {
    for _ in 0..bytes.int_in_range(0..=4)? {
        let into = bytes.int_in_range(0..=3)?;
        let FakeExecutorState {
            tables,
            status,
            timing,
            answers,
            ..
        } = fake;
        let record = match into {
            0 => bytes_of_mut(&mut **tables),
            1 => bytes_of_mut(status),
            2 => bytes_of_mut(&mut **timing),
            _ => {
                let length = bytes.int_in_range(0..=40)?;
                answers.push_back(bytes.bytes(length.min(bytes.len()))?.to_vec());
                continue;
            }
        };
        let at = bytes.int_in_range(0..=record.len() / 4 - 1)? * 4;
        let word = match bool::arbitrary(bytes)? {
            true => u32::from(u8::arbitrary(bytes)?),
            false => u32::arbitrary(bytes)?,
        };
        record[at..at + 4].copy_from_slice(&word.to_le_bytes());
    }
    Ok(())
}

fn request(bytes: &mut Unstructured<'_>) -> Result<Option<Request<Body>>> {
    const METHODS: [&str; 7] = ["GET", "POST", "DELETE", "PUT", "HEAD", "OPTIONS", "PATCH"];
    const ENDS: [&str; 14] = [
        "",
        "/start",
        "/cancel",
        "/abort",
        "/nothing",
        "/",
        "?file=a",
        "?file=%ff",
        "/start?x=1",
        "/inputs",
        "/inputs/stream",
        "/values",
        "/values?ports=*",
        "/values?ports=move.pose[1],*.out",
    ];
    let method = *bytes.choose(&METHODS)?;
    let address = match bytes.int_in_range(0..=13)? {
        10 => format!("/events?after={}", word(bytes)?),
        11 => "/incidents".to_owned(),
        12 => format!("/incidents/{}", word(bytes)?),
        13 => format!("/check?file={}", word(bytes)?),
        8 => "/timing".to_owned(),
        9 => "/status/acknowledge".to_owned(),
        0 => "/devices".to_owned(),
        1 => "/status".to_owned(),
        2 => "/commands".to_owned(),
        3 => "/primitives".to_owned(),
        4 => format!(
            "/commands/{}{}",
            bytes.int_in_range(0..=110)?,
            bytes.choose(&ENDS)?
        ),
        5 => format!("/commands?file={}", word(bytes)?),
        6 => format!("/commands/{}{}", word(bytes)?, bytes.choose(&ENDS)?),
        _ => format!("/{}", word(bytes)?),
    };
    // Its answer has no end.
    if address.starts_with("/stream") {
        return Ok(None);
    }
    let length = bytes.arbitrary_len::<u8>()?;
    let body = bytes.bytes(length)?.to_vec();
    Ok(Request::builder()
        .method(method)
        .uri(address)
        .extension(ClientPeer::Process(1))
        .body(Body::from(body))
        .ok())
}

fn word(bytes: &mut Unstructured<'_>) -> Result<String> {
    let length = bytes.int_in_range(0..=24)?;
    Ok(String::from_utf8_lossy(bytes.bytes(length.min(bytes.len()))?).into_owned())
}

/// Checks that an answer is one of the interface: a known status, and JSON with a code of the table for an error.
fn check_answer(harness: &mut RestHarness, request: Request<Body>) {
    let (shown, head) = (format!("{request:?}"), request.method() == "HEAD");
    let call = harness.router.call(request);
    let (status, body) = harness.runtime.block_on(async {
        let answer: std::result::Result<_, Infallible> = call.await;
        let Ok(answer) = answer;
        let (parts, body) = answer.into_parts();
        let body = to_bytes(body, ANSWER_MAX).await;
        (parts.status, body.unwrap_or_else(|error| panic!("{error}")))
    });
    if status.is_success() || head {
        return;
    }
    let body: serde_json::Value = match serde_json::from_slice(&body) {
        Ok(body) => body,
        Err(error) => panic!("{shown}: {status} with {body:?}: {error}"),
    };
    let code = body["code"]
        .as_str()
        .or_else(|| body["error"]["code"].as_str())
        .unwrap_or_default();
    let row = codes::TABLE.iter().find(|row| row.code == code);
    let Some(row) = row else {
        panic!("{shown}: {status} with a code that is not in the table: {body}");
    };
    assert_eq!(
        StatusCode::from_u16(row.status).ok(),
        Some(status),
        "{shown}: {body}"
    );
    assert_ne!(row.code, codes::PROCESS_FAILED.code, "{shown}: {body}");
}
