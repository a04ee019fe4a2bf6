//! `install-units` writes units that systemd accepts and rates as safe, and removes them again. The tests use
//! `systemd-analyze` instead of a running systemd. Run by the threads of the test harness.

use std::collections::BTreeMap;
use std::fs;
use std::process::{Command, Output};

use rcc_testing::TempDir;

use crate::program::{rcc_cli, repository};

/// Highest exposure by `systemd-analyze security`, in tenths: 33 = 3.3 "OK".
const EXPOSURE_MAX: u32 = 33;

/// A temporary root folder of one test, removed at the end.
struct Root(TempDir);

impl Root {
    fn new() -> Root {
        Root(rcc_testing::folder())
    }

    fn install(&self, config: &str, more: &[&str]) -> Output {
        // An absolute path stays as it is.
        let config = repository().join("configs/cells").join(config);
        let mut command = rcc_cli(&["install-units"]);
        command.arg(config).arg("--root").arg(self.0.path());
        command.args(more).env_remove("RCC_CELL");
        command.output().expect("rcc-cli runs")
    }

    /// Returns all files below it, with their contents.
    fn files(&self) -> BTreeMap<String, String> {
        let mut files = BTreeMap::new();
        let mut folders = vec![self.0.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap().flatten() {
                let path = entry.path();
                if path.is_dir() {
                    folders.push(path);
                } else {
                    let name = path
                        .strip_prefix(self.0.path())
                        .unwrap()
                        .display()
                        .to_string();
                    files.insert(name, fs::read_to_string(&path).unwrap());
                }
            }
        }
        files
    }

    /// Runs systemd-analyze on these units; `None` if the machine has none.
    fn analyze(&self, arguments: &[&str], unit: &str) -> Option<Output> {
        let ran = Command::new("systemd-analyze")
            .args(arguments)
            .arg(unit)
            // The trailing colon appends the system's own units.
            .env(
                "SYSTEMD_UNIT_PATH",
                format!("{}/etc/systemd/system:", self.0.path().display()),
            )
            .output();
        ran.map_err(|_| eprintln!("skipped: this machine has no systemd-analyze"))
            .ok()
    }
}

const DEMO: [&str; 4] = ["--simulators", "--port", "fri=49938", "--port=io=49940"];

/// Names of the demo cell's units.
const UNITS: [&str; 10] = [
    "rcc.target",
    "rcc@demo.target",
    "rcc-rt-setup.service",
    "rcc-executor@demo.service",
    "rcc-loader@demo.service",
    "rcc-driver@demo.lwr.service",
    "rcc-driver@demo.io.service",
    "rcc-simulator@demo.lwr-sim.service",
    "rcc-simulator@demo.io-sim.service",
    "rcc.slice",
];

fn succeeds(output: &Output) -> String {
    let (out, errors) = (text(&output.stdout), text(&output.stderr));
    assert!(
        output.status.success(),
        "{}\n{out}\n{errors}",
        output.status
    );
    out
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn systemd_accepts_every_unit() {
    let root = Root::new();
    succeeds(&root.install("demo.yaml", &DEMO));
    for unit in UNITS {
        let Some(output) = root.analyze(&["verify", "--man=no"], unit) else {
            return;
        };
        let said = text(&output.stderr);
        assert!(output.status.success(), "{unit}: {said}");
        assert!(!said.contains("rcc"), "{unit}: {said}");
    }
}

#[test]
fn every_service_is_confined() {
    let root = Root::new();
    succeeds(&root.install("demo.yaml", &DEMO));
    let threshold = format!("--threshold={EXPOSURE_MAX}");
    for unit in UNITS.iter().filter(|unit| unit.ends_with(".service")) {
        let Some(output) = root.analyze(
            &["security", "--offline=true", "--no-pager", &threshold],
            unit,
        ) else {
            return;
        };
        let said = text(&output.stdout);
        assert!(
            output.status.success(),
            "{unit}: {said}\n{}",
            text(&output.stderr)
        );
        println!("{}", said.lines().last().unwrap_or_default());
    }
}

#[test]
fn the_configuration_decides_restarts_priorities_cores_and_addresses() {
    let root = Root::new();
    succeeds(&root.install(
        "lwr.yaml",
        &["--cpus", "0,2-3", "--programs", "/opt/rcc/bin"],
    ));
    let files = root.files();
    let units = "etc/systemd/system";
    let executor = &files[&format!("{units}/rcc-executor@lwr.service.d/50-cell.conf")];
    for line in [
        "StartLimitBurst=6",
        "LimitRTPRIO=80",
        "CPUAffinity=0,2-3",
        "WatchdogSec=2000ms",
    ] {
        assert!(
            executor.lines().any(|have| have == line),
            "{line} is not in\n{executor}"
        );
    }
    let driver = &files[&format!("{units}/rcc-driver@lwr.lwr.service.d/50-cell.conf")];
    for line in [
        "IPAddressAllow=192.168.0.0/24",
        "LimitRTPRIO=70",
        "Before=rcc-executor@lwr.service",
    ] {
        assert!(
            driver.lines().any(|have| have == line),
            "{line} is not in\n{driver}"
        );
    }
    let target = &files[&format!("{units}/rcc@lwr.target.d/50-cell.conf")];
    assert!(
        target.contains("Wants=rcc-driver@lwr.lwr.service\n"),
        "{target}"
    );
    let unit = &files[&format!("{units}/rcc-executor@.service")];
    assert!(unit.contains("ExecStart=/opt/rcc/bin/rcc-exec\n"), "{unit}");
}

#[test]
fn a_driver_with_a_program_of_its_own_gets_raw_packets_and_no_more() {
    let root = Root::new();
    succeeds(&root.install(
        "ethercat.yaml",
        &[
            "--port",
            "line=4711",
            "--simulators",
            "--programs",
            "/opt/rcc/bin",
        ],
    ));
    let files = root.files();
    let driver = &files["etc/systemd/system/rcc-driver@ethercat.line.service.d/50-cell.conf"];
    for line in [
        r#"ExecStart="/opt/rcc/bin/rcc-ethercat""#,
        "CapabilityBoundingSet=CAP_NET_RAW",
        "RestrictAddressFamilies=AF_PACKET",
        // Of the simulated line.
        "IPAddressAllow=127.0.0.1",
    ] {
        assert!(
            driver.lines().any(|have| have == line),
            "{line} is not in\n{driver}"
        );
    }
}

/// Installs the units of a cell `feeder` with a device `press`; returns the unit of that device, and all files.
fn device_unit(root: &Root, file: &str, text: &str) -> (String, BTreeMap<String, String>) {
    let config = root.0.path().join(file);
    fs::write(&config, text).unwrap();
    succeeds(&root.install(config.to_str().unwrap(), &[]));
    let files = root.files();
    let unit = &files["etc/systemd/system/rcc-driver@feeder.press.service.d/50-cell.conf"];
    (unit.clone(), files)
}

#[test]
fn a_link_device_may_use_its_endpoints() {
    for (settings, address) in [
        (
            r#"connect: ["tcp/192.168.0.1:7447"]"#,
            "IPAddressAllow=192.168.0.1",
        ),
        (
            r#"router: ["tcp/192.168.0.9:7447"]"#,
            "IPAddressAllow=192.168.0.9",
        ),
        (
            r#"listen: ["tls/192.168.0.1:7447"]"#,
            "IPAddressAllow=192.168.0.0/24",
        ),
        (
            r#"connect: ["tls/press.lab:7447"]"#,
            "# tls/press.lab:7447 names a host: nothing can be filtered.\nIPAddressAllow=any",
        ),
    ] {
        let cell = format!(
            "cell: feeder\nperiod: 1 ms\ndevices:\n  press:\n    driver: {{program: rcc-link-device}}\n    \
             settings: {{peer: lab/press, {settings}}}\n    \
             channels: {{open: {{kind: digital input, address: door/open}}}}\n"
        );
        let (unit, _) = device_unit(&Root::new(), "feeder.yaml", &cell);
        assert!(unit.contains(&format!("\n{address}\n")), "{unit}");
        assert_eq!(unit.matches("IPAddressAllow=").count(), 1, "{unit}");
    }
}

#[test]
fn a_dollar_is_doubled_where_systemd_expands_it_and_nowhere_else() {
    let cell = "cell: feeder\nperiod: 1 ms\nrecorder: {folder: /data/$rcc}\ndevices:\n  press:\n    \
                driver: {program: /opt/$own/press, arguments: [--user=$HOME]}\n    \
                channels: {open: {kind: digital input, address: open}}\n";
    let root = Root::new();
    let (unit, files) = device_unit(&root, "a$b.yaml", cell);
    let config = format!("\"RCC_CONFIG={}/a$b.yaml\"", root.0.path().display());
    for part in [
        "\nReadWritePaths=\"-/data/$rcc\"\n",
        "\nExecStart=\"/opt/$own/press\" \"--user=$$HOME\"\n",
    ] {
        assert!(unit.contains(part), "{part} is not in\n{unit}");
    }
    for unit in ["executor@feeder", "loader@feeder", "driver@feeder.press"] {
        let drop_in = &files[&format!("etc/systemd/system/rcc-{unit}.service.d/50-cell.conf")];
        assert!(drop_in.contains(&config), "{config} is not in\n{drop_in}");
    }
}

#[test]
fn configurations_not_for_production_are_refused_with_the_remedy() {
    let root = Root::new();
    let output = root.install("demo.yaml", &[]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("fri, io") && said.contains("--port fri="),
        "{said}"
    );
    let output = root.install("demo.yaml", &DEMO[1..]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("simulators (lwr-sim, io-sim)") && said.contains("--simulators"),
        "{said}"
    );
    assert!(root.files().is_empty());
}

#[test]
fn units_not_written_by_rcc_are_never_changed() {
    let root = Root::new();
    let folder = root.0.path().join("etc/systemd/system");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("rcc.target"), "[Unit]\nDescription=mine\n").unwrap();
    let output = root.install("lwr.yaml", &[]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(5), "{said}");
    assert!(
        said.contains("rcc.target exists and was not written by RCC"),
        "{said}"
    );
    assert_eq!(root.files().len(), 1, "nothing was written");
}

#[test]
fn a_dry_run_writes_nothing_and_a_second_run_changes_nothing() {
    let root = Root::new();
    let said = succeeds(&root.install("lwr.yaml", &["--dry-run"]));
    assert!(said.contains("rcc-driver@lwr.lwr.service.d"), "{said}");
    assert!(root.files().is_empty());
    let (lines, last) = said.trim_end().rsplit_once('\n').unwrap();
    assert!(
        lines.lines().all(|line| line.starts_with("would write ")),
        "{said}"
    );
    let count = lines.lines().count();
    assert_eq!(
        last,
        format!("{count} files would change; nothing was changed (--dry-run)")
    );
    succeeds(&root.install("lwr.yaml", &[]));
    let files = root.files();
    let said = succeeds(&root.install("lwr.yaml", &[]));
    assert!(
        said.lines()
            .filter(|line| line.starts_with("unchanged"))
            .count()
            == files.len(),
        "{said}"
    );
    assert_eq!(root.files(), files);
}

#[test]
fn uninstall_keeps_other_cells_and_finally_removes_everything() {
    let root = Root::new();
    succeeds(&root.install("lwr.yaml", &[]));
    let one = root.files();
    succeeds(&root.install("demo.yaml", &DEMO));
    succeeds(&root.install("demo.yaml", &["--uninstall"]));
    assert_eq!(root.files(), one);
    succeeds(&root.install("lwr.yaml", &["--uninstall"]));
    assert_eq!(root.files(), BTreeMap::new());
}

#[test]
fn uninstall_keeps_the_files_of_a_package() {
    let root = Root::new();
    let shipped = repository().join("configs/systemd");
    let packaged = |name: &str| match name {
        "sysusers.conf" => "usr/lib/sysusers.d/rcc.conf".to_owned(),
        "tmpfiles.conf" => "usr/lib/tmpfiles.d/rcc.conf".to_owned(),
        "limits.conf" => "etc/security/limits.d/rcc.conf".to_owned(),
        unit => format!("usr/lib/systemd/system/{unit}"),
    };
    for entry in fs::read_dir(shipped).unwrap().flatten() {
        let to = root
            .0
            .path()
            .join(packaged(entry.file_name().to_str().unwrap()));
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(entry.path(), to).unwrap();
    }
    // The administrator has changed what the package installed.
    let limits = root.0.path().join("etc/security/limits.d/rcc.conf");
    let text = fs::read_to_string(&limits).unwrap() + "@rcc - nofile 4096\n";
    fs::write(&limits, text).unwrap();
    let before = root.files();
    let said = succeeds(&root.install("lwr.yaml", &[]));
    for path in [
        "etc/systemd/system/rcc.target",
        "etc/security/limits.d/rcc.conf",
    ] {
        let line = |line: &&str| line.starts_with("packaged") && line.ends_with(path);
        assert!(said.lines().any(|one| line(&one)), "{path}: {said}");
    }
    succeeds(&root.install("lwr.yaml", &["--uninstall"]));
    assert_eq!(root.files(), before);
}

#[test]
fn a_dry_run_of_uninstall_says_so_and_removes_nothing() {
    let root = Root::new();
    succeeds(&root.install("lwr.yaml", &[]));
    let files = root.files();
    let said = succeeds(&root.install("lwr.yaml", &["--uninstall", "--dry-run"]));
    let would = said
        .lines()
        .filter(|line| line.starts_with("would remove "));
    assert_eq!(would.count(), files.len(), "{said}");
    assert_eq!(said.matches("--dry-run").count(), 1, "{said}");
    assert!(!said.contains("next:"), "{said}");
    assert_eq!(root.files(), files);
}

#[test]
fn the_unit_of_a_removed_device_is_removed() {
    let root = Root::new();
    succeeds(&root.install("demo.yaml", &DEMO));
    let more = [&DEMO[1..], &["--cell", "demo"]].concat();
    let config = root.0.path().join("demo.yaml");
    let shipped = repository().join("configs");
    let text = fs::read_to_string(shipped.join("cells/demo.yaml")).unwrap();
    let robots = shipped.join("robots").canonicalize().unwrap();
    let text = text.replace("../robots", robots.to_str().unwrap());
    let (head, _) = text.split_at(text.find("  io:\n    driver: modbus").unwrap());
    let from = head.find("simulators:").unwrap();
    let to = head.find("devices:").unwrap();
    fs::write(&config, head[..from].to_owned() + &head[to..]).unwrap();
    let said = succeeds(&root.install(config.to_str().unwrap(), &more));
    assert!(
        said.contains("removed") && said.contains("rcc-driver@demo.io.service.d"),
        "{said}"
    );
    let files = root.files();
    let left: Vec<&String> = files
        .keys()
        .filter(|name| name.contains("simulator@demo"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn services_keep_their_state_and_a_configured_folder_is_writable() {
    let root = Root::new();
    let demo = repository().join("configs/cells/demo.yaml");
    let robots = repository().join("configs/robots");
    let robots = robots.canonicalize().unwrap();
    let text = fs::read_to_string(demo).unwrap();
    let text = text.replace("../robots", robots.to_str().unwrap());
    let config = root.0.path().join("cell.yaml");
    fs::write(&config, text + "\nrecorder: {folder: /data/my rcc}\n").unwrap();
    succeeds(&root.install(config.to_str().unwrap(), &DEMO));
    let files = root.files();
    for unit in ["executor@", "loader@", "driver@"] {
        let shipped = &files[&format!("etc/systemd/system/rcc-{unit}.service")];
        assert!(shipped.contains("\nStateDirectory=rcc\n"), "{shipped}");
    }
    for unit in [
        "executor@demo",
        "loader@demo",
        "driver@demo.lwr",
        "driver@demo.io",
    ] {
        let drop_in = &files[&format!("etc/systemd/system/rcc-{unit}.service.d/50-cell.conf")];
        let writable = "\nReadWritePaths=\"-/data/my rcc\"\n";
        assert!(drop_in.contains(writable), "{drop_in}");
    }
}
