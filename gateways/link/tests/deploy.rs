//! Rolling deployment to cells that this test answers for, on loopback. Run by the threads of the test harness.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};

use rcc_link::deploy::{DeployError, DeployText, Deployment, select, withdraw};
use rcc_link::fleet::{self, FoundCell};
use rcc_link::keys::CellKeys;
use rcc_link::session;
use zenoh::{Session, Wait};

const NET: &str = "net: line\nprimitives: {}\n";
const CELLS: [&str; 3] = ["lab/a", "lab/b", "lab/c"];

/// The behaviour of one cell: it answers a request, refuses it, or ends without an answer.
type Behaviour = fn(operation: &str) -> Option<Result<&'static str, &'static str>>;

/// Cells that answer, and what they were asked for.
struct Cells {
    asked: Arc<Mutex<Vec<String>>>,
    endpoints: Vec<String>,
    sessions: Vec<Session>,
}

impl Cells {
    fn new(behaviours: [Behaviour; 3]) -> Cells {
        let mut cells = Cells {
            asked: Arc::default(),
            endpoints: Vec::new(),
            sessions: Vec::new(),
        };
        for (cell, behaviour) in CELLS.into_iter().zip(behaviours) {
            let port = rcc_config::free_port(rcc_config::Protocol::Tcp).expect("a port");
            let endpoint = format!("tcp/127.0.0.1:{port}");
            let listen = std::slice::from_ref(&endpoint);
            let session = session::open(listen, &[], None).expect("a session");
            let (asked, own, keys) = (
                Arc::clone(&cells.asked),
                session.clone(),
                CellKeys::of(cell),
            );
            let queryable = session
                .declare_queryable(keys.requests())
                .callback(move |query| {
                    let key = keys.parse_request(query.key_expr().as_str());
                    let operation = key.expect("a request").operation.name();
                    asked
                        .lock()
                        .expect("a list")
                        .push(format!("{cell} {operation}"));
                    let replied = match behaviour(operation) {
                        Some(Ok(body)) => {
                            let key = query.key_expr();
                            query.reply(key, body).attachment(key.as_str()).wait()
                        }
                        Some(Err(body)) => query.reply_err(body).wait(),
                        None => {
                            // The cell ends with the request in its hands.
                            let own = own.clone();
                            std::thread::spawn(move || drop(own.close().wait()));
                            std::mem::forget(query);
                            return;
                        }
                    };
                    replied.expect("answered");
                });
            queryable.background().wait().expect("a queryable");
            cells.endpoints.push(endpoint);
            cells.sessions.push(session);
        }
        cells
    }

    fn connect(&self) -> Session {
        fleet::connect(&self.endpoints, None).expect("a connection")
    }

    fn asked(&self, operation: &str) -> Vec<String> {
        let asked = self.asked.lock().expect("a list");
        let of = |row: &&String| row.ends_with(operation);
        asked.iter().filter(of).cloned().collect()
    }
}

fn takes(operation: &str) -> Option<Result<&'static str, &'static str>> {
    Some(Ok(match operation {
        "check" => r#"{"uses": ["arm"]}"#,
        _ => r#"{"name": "line#7"}"#,
    }))
}

fn has_no_arm(operation: &str) -> Option<Result<&'static str, &'static str>> {
    match operation {
        "check" => Some(Err(r#"{"error": "this cell has no device `arm`"}"#)),
        _ => takes(operation),
    }
}

fn dies_at_check(operation: &str) -> Option<Result<&'static str, &'static str>> {
    match operation {
        "check" => None,
        _ => takes(operation),
    }
}

fn dies_at_load(operation: &str) -> Option<Result<&'static str, &'static str>> {
    match operation {
        "load" => None,
        _ => takes(operation),
    }
}

fn deploy(cells: &Cells) -> Result<Vec<String>, DeployError> {
    let session = cells.connect();
    let names = CELLS.map(str::to_owned);
    let texts = [DeployText::of("line.yaml", NET).expect("a net")];
    let deployment = Deployment {
        session: &session,
        peer: "lab/office",
        cells: &names,
        texts: &texts,
    };
    let mut lines = deployment.check()?;
    deployment.roll(|done| lines.push(done.to_string()))?;
    Ok(lines)
}

#[test]
fn every_cell_gets_it_in_turn_if_all_would_take_it() {
    let cells = Cells::new([takes, takes, takes]);
    let lines = deploy(&cells).expect("deployed");
    assert_eq!(lines.len(), 6, "{lines:?}");
    assert_eq!(lines[0], "lab/a  line.yaml is valid  uses: arm");
    assert_eq!(lines[5], "lab/c  line#7 is ready");
    assert_eq!(
        cells.asked("load"),
        CELLS.map(|cell| format!("{cell} load"))
    );
}

/// A gateway has room for four texts that wait: more at a time would be refused.
#[test]
fn all_cells_are_asked_together_and_each_about_one_text_after_the_other() {
    const NETS: usize = 8;
    let cells = Cells::new([takes, takes, takes]);
    let session = cells.connect();
    let names = CELLS.map(str::to_owned);
    let texts: Vec<DeployText> = (0..NETS)
        .map(|number| {
            let text = NET.replacen("line", &format!("line-{number}"), 1);
            DeployText::of(&format!("line-{number}.yaml"), &text).expect("a net")
        })
        .collect();
    let deployment = Deployment {
        session: &session,
        peer: "lab/office",
        cells: &names,
        texts: &texts,
    };
    let lines = deployment.check().expect("all are valid");
    // One request of each cell, and then the next one.
    let asked = cells.asked("check");
    assert_eq!(asked.len(), NETS * CELLS.len());
    for (number, round) in asked.chunks(CELLS.len()).enumerate() {
        let round: BTreeSet<&str> = round.iter().map(String::as_str).collect();
        assert_eq!(round.len(), CELLS.len(), "{number}: {asked:?}");
    }
    // Messages are in the order of cells and texts.
    let told = CELLS.iter().flat_map(|cell| {
        (0..NETS).map(move |number| format!("{cell}  line-{number}.yaml is valid  uses: arm"))
    });
    assert_eq!(lines, told.collect::<Vec<String>>());
}

/// Each further question would wait for the longest time that an answer may take.
#[test]
fn a_cell_that_does_not_answer_is_not_asked_again() {
    let cells = Cells::new([takes, dies_at_check, takes]);
    let session = cells.connect();
    let names = CELLS.map(str::to_owned);
    let texts = ["one.yaml", "two.yaml"].map(|file| DeployText::of(file, NET).expect("a net"));
    let deployment = Deployment {
        session: &session,
        peer: "lab/office",
        cells: &names,
        texts: &texts,
    };
    let Err(DeployError::Refused(refusals)) = deployment.check() else {
        panic!("it is refused");
    };
    let told: Vec<String> = refusals.iter().map(ToString::to_string).collect();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(
        told[0].starts_with("one.yaml: lab/b does not answer"),
        "{told:?}"
    );
    assert_eq!(cells.asked("check").len(), 5);
}

#[test]
fn a_net_that_one_cell_refuses_reaches_none() {
    let cells = Cells::new([takes, has_no_arm, takes]);
    let refused = deploy(&cells).expect_err("refused");
    assert!(matches!(refused, DeployError::Refused(_)), "{refused}");
    assert_eq!(
        refused.to_string(),
        "nothing was changed on any cell:\nline.yaml: lab/b: this cell has no device `arm`"
    );
    assert_eq!(cells.asked("check").len(), 3);
    assert!(cells.asked("load").is_empty());
}

#[test]
fn a_cell_that_dies_in_the_middle_stops_the_deployment_and_the_way_back_is_told() {
    let cells = Cells::new([takes, dies_at_load, takes]);
    let stopped = deploy(&cells).expect_err("stopped");
    assert!(matches!(stopped, DeployError::Stopped(_)), "{stopped}");
    let stopped = stopped.to_string();
    for words in [
        "stopped: line.yaml: lab/b does not answer",
        "whether lab/b has it is not known",
        "has it: lab/a  line#7 is ready",
        "has it not: lab/c",
        "rcc-link withdraw 'lab/a/line#7'",
    ] {
        assert!(stopped.contains(words), "{words}: {stopped}");
    }
    assert_eq!(cells.asked("load"), ["lab/a load", "lab/b load"]);
}

#[test]
fn a_cell_that_is_not_there_is_named() {
    let found: BTreeMap<String, FoundCell> = ["lab/a", "lab/b", "hall/a"]
        .map(|cell| (cell.to_owned(), FoundCell::default()))
        .into();
    let cells = |patterns: &[&str], expected| {
        let patterns: Vec<String> = patterns.iter().map(|it| (*it).to_owned()).collect();
        select(&found, &patterns, expected).map_err(|error| error.to_string())
    };
    assert_eq!(
        cells(&["lab/*"], Some(2)),
        Ok(vec!["lab/a".to_owned(), "lab/b".to_owned()])
    );
    assert_eq!(cells(&["*/a", "lab/a"], None).map(|all| all.len()), Ok(2));
    let missing = cells(&["lab/c", "lab/*"], None).expect_err("not there");
    assert_eq!(
        missing,
        "no cell answers to `lab/c`; those that are there: hall/a, lab/a, lab/b"
    );
    let few = cells(&["lab/*"], Some(3)).expect_err("too few");
    assert_eq!(few, "3 cells were expected, and 2 are there: lab/a, lab/b");
}

#[test]
fn a_configuration_goes_to_the_cell_of_its_name_only() {
    let cells = Cells::new([takes, takes, takes]);
    let session = cells.connect();
    let names = CELLS.map(str::to_owned);
    let file = |name: &str| DeployText::of("cell.yaml", &format!("cell: {name}\nperiod: 1 ms\n"));
    let deployment = |texts: &[DeployText]| {
        let deployment = Deployment {
            session: &session,
            peer: "lab/office",
            cells: &names,
            texts,
        };
        deployment.check()?;
        deployment.roll(|_| {})
    };
    deployment(&[file("b").expect("a cell")]).expect("deployed");
    assert_eq!(cells.asked("check"), ["lab/b check"]);
    assert_eq!(cells.asked("replace"), ["lab/b replace"]);
    let other = deployment(&[file("d").expect("a cell")]).expect_err("no such cell");
    assert_eq!(
        other.to_string(),
        "cell.yaml is the configuration of cell `d`, which is none of lab/a, lab/b, lab/c"
    );
    let robot = DeployText::of("ur5e.yaml", "robot: ur5e\n").expect_err("a robot");
    assert!(
        robot.to_string().contains("is neither a net nor"),
        "{robot}"
    );
}

#[test]
fn every_cell_answers_as_soon_as_the_connection_is_made() {
    const CONNECTIONS: usize = 40;
    let cells = Cells::new([takes, takes, takes]);
    for _ in 0..CONNECTIONS {
        let session = cells.connect();
        for cell in CELLS {
            withdraw(&session, "lab/office", cell, "line#7").expect("withdrawn");
        }
        session.close().wait().expect("closed");
    }
    assert_eq!(cells.asked("unload").len(), CONNECTIONS * CELLS.len());
}
