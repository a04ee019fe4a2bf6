//! Three cells of this host with certificates, each with its gateway, and a person who may deploy.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};

use nix::sys::signal::Signal;
use rcc_tests::cell::TestCell;
use rcc_tests::cell_fixture::{CellFixture, await_told};
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::programs::{program, repository};

/// Sites of the cells, which all have the name `test`.
pub(super) const SITES: [&str; 3] = ["lab-a", "lab-b", "lab-c"];
/// A person who may deploy nets and configurations.
pub(super) const OFFICE: &str = "lab/office";
/// A person who may do nothing.
pub(super) const VISITOR: &str = "lab/visitor";

/// The arm of a cell.
#[derive(Clone, Copy)]
pub(super) enum Arm {
    /// There is one.
    Ideal,
    /// It has another name.
    Renamed,
    /// Its robot is switched off, so that its position is not known.
    Off,
}

impl Arm {
    fn devices(self) -> String {
        let ideal = "driver: ideal-arm, robot: ../robots/lwr4plus.yaml, first_tolerance: deg(0.1), delay: 80 ms, settings: {start: [0, \
                     -30 deg, 0, 90 deg, 0, -60 deg, 0]}";
        match self {
            Arm::Ideal => format!("devices:\n  lwr: {{{ideal}}}\n"),
            Arm::Renamed => format!("devices:\n  other: {{{ideal}}}\n"),
            Arm::Off => "ports: {fri: auto udp}\ndevices:\n  lwr:\n    driver: fri-lwr\n    robot: ../robots/lwr4plus.yaml\n    \
                         first_tolerance: deg(0.1)\n    settings: {listen: \"127.0.0.1:${fri}\", krl: first-app}\n"
                .to_owned(),
        }
    }
}

/// Makes certificates as `docs/link.md` does.
struct Authority(PathBuf);

impl Authority {
    fn new(folder: PathBuf) -> Result<Authority, String> {
        fs::create_dir_all(&folder).map_err(|error| error.to_string())?;
        let authority = Authority(folder);
        let curve = [
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
        ];
        let own = [
            "-days", "2", "-subj", "/CN=lab", "-keyout", "ca.key", "-out", "ca.pem",
        ];
        authority.openssl(&[&["req", "-x509"][..], &curve, &own].concat())?;
        for site in SITES {
            authority.sign(&format!("{site}/test"))?;
        }
        authority.sign(OFFICE)?;
        authority.sign(VISITOR)?;
        Ok(authority)
    }

    fn openssl(&self, arguments: &[&str]) -> Result<(), String> {
        let output = Command::new("openssl")
            .args(arguments)
            .current_dir(&self.0)
            .output();
        let output = output.map_err(|error| format!("needs openssl: {error}"))?;
        match output.status.success() {
            true => Ok(()),
            false => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
        }
    }

    fn sign(&self, name: &str) -> Result<(), String> {
        let file = name.replace('/', "-");
        let [key, request, certificate] =
            ["key", "csr", "pem"].map(|ending| format!("{file}.{ending}"));
        let subject = format!("/CN={}", name.replace('/', "\\/"));
        self.openssl(&[
            "req",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-subj",
            &subject,
            "-keyout",
            &key,
            "-out",
            &request,
        ])?;
        fs::write(self.0.join("address"), "subjectAltName=IP:127.0.0.1")
            .map_err(|error| error.to_string())?;
        self.openssl(&[
            "x509",
            "-req",
            "-in",
            &request,
            "-CA",
            "ca.pem",
            "-CAkey",
            "ca.key",
            "-days",
            "2",
            "-extfile",
            "address",
            "-out",
            &certificate,
        ])
    }

    /// Returns the paths of authority, certificate and key of a name.
    fn files(&self, name: &str) -> [String; 3] {
        let file = name.replace('/', "-");
        [
            "ca.pem".to_owned(),
            format!("{file}.pem"),
            format!("{file}.key"),
        ]
        .map(|file| self.0.join(file).display().to_string())
    }
}

pub(super) struct Fleet {
    pub cells: [TestCell; 3],
    gateways: Vec<Child>,
    authority: Authority,
    endpoints: String,
}

impl Fleet {
    /// Starts three cells with these arms, and waits until their gateways answer; the error says why it cannot be.
    pub fn start(arms: [Arm; 3]) -> Result<Fleet, String> {
        super::installed()?;
        let base = repository().join("configs/cells/by-joints.yaml");
        let mut authority = None;
        let mut endpoints = Vec::new();
        let mut cells = Vec::new();
        for (site, arm) in SITES.into_iter().zip(arms) {
            let port = rcc_config::free_port(rcc_config::Protocol::Tcp)
                .map_err(|error| error.to_string())?;
            let place = CellFixture::new(&base, |_| {
                format!("cell: test\nperiod: 1 ms\n{}", arm.devices())
            });
            if authority.is_none() {
                authority = Some(Authority::new(place.folder().join("tls"))?);
            }
            let [ca, certificate, key] = authority
                .as_ref()
                .expect("made above")
                .files(&format!("{site}/test"));
            let link = format!(
                "link:\n  site: {site}\n  listen: [\"tls/127.0.0.1:{port}\"]\n  deploy: [{OFFICE}]\n  configure: [{OFFICE}]\n  tls: \
                 {{authority: {ca}, certificate: {certificate}, key: {key}}}\nperiod: 1 ms\nstale_after: 250 ms\n"
            );
            let text = fs::read_to_string(place.config()).expect("the configuration");
            fs::write(place.config(), text.replacen("period: 1 ms\n", &link, 1)).expect("written");
            endpoints.push(format!("tls/127.0.0.1:{port}"));
            cells.push(TestCell::begin(place));
        }
        let cells: [TestCell; 3] = cells.try_into().unwrap_or_else(|_| panic!("three cells"));
        let mut fleet = Fleet {
            cells,
            gateways: Vec::new(),
            authority: authority.expect("made above"),
            endpoints: endpoints.join(","),
        };
        for index in 0..SITES.len() {
            let gateway = fleet.gateway(index);
            fleet.gateways.push(gateway);
        }
        for (cell, arm) in fleet.cells.iter().zip(arms) {
            match arm {
                Arm::Ideal => cell.await_device("lwr", "ready"),
                Arm::Renamed => cell.await_device("other", "ready"),
                Arm::Off => {}
            }
        }
        await_told("all cells over the link", || {
            let (listed, _) = fleet.link(OFFICE, &["cells"]);
            let is_alive = |site: &&str| listed.contains(&format!("{site}/test  alive  cycle"));
            match SITES.iter().all(is_alive) {
                true => Ok(()),
                false => Err(listed),
            }
        });
        Ok(fleet)
    }

    fn gateway(&self, index: usize) -> Child {
        let cell = &self.cells[index];
        let mut command = cell.program("rcc-link");
        command.arg("serve").arg("--config").arg(cell.config());
        ends_with_test(&mut command)
            .spawn()
            .expect("rcc-link starts")
    }

    /// Kills the gateway of a cell.
    pub fn kill_gateway(&mut self, index: usize) {
        let mut gateway = self.gateways.remove(index);
        gateway.kill().expect("it is a child");
        gateway.wait().expect("it is a child");
    }

    /// Runs `rcc-link` as a person; returns what it says, and whether it succeeded.
    pub fn link(&self, person: &str, arguments: &[&str]) -> (String, bool) {
        let [ca, certificate, key] = self.authority.files(person);
        let mut command = Command::new(program("rcc-link"));
        let command = command
            .args(arguments)
            .env("RCC_LINK_CONNECT", &self.endpoints)
            .env("RCC_LINK_AUTHORITY", ca)
            .env("RCC_LINK_CERTIFICATE", certificate)
            .env("RCC_LINK_KEY", key);
        let Output {
            status,
            stdout,
            stderr,
        } = command.output().expect("rcc-link runs");
        let text = String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned();
        (text, status.success())
    }

    /// Deploys a text to all cells as a person.
    pub fn deploy(&self, person: &str, text: &str) -> (String, bool) {
        let file = self.cells[0].file(text);
        self.link(
            person,
            &[
                "deploy",
                "--to",
                "lab-?/test",
                "--expect",
                "3",
                &path(&file),
            ],
        )
    }

    /// Names and states of the nets of each cell.
    pub fn nets(&self) -> [String; 3] {
        [0, 1, 2].map(|index| {
            let reply = self.cells[index].rest("GET", "/commands", "");
            let rows = reply.body.as_array().into_iter().flatten();
            let rows = rows.map(|row| format!("{} {}", row["net"], row["state"]).replace('"', ""));
            rows.collect::<Vec<_>>().join(", ")
        })
    }

    /// Ends everything, and asserts that nothing is left.
    pub fn stop(self) {
        for mut gateway in self.gateways {
            signal(gateway.id(), Signal::SIGTERM);
            let status = gateway.wait().expect("it is a child");
            assert!(status.success(), "{status:?}");
        }
        self.cells.into_iter().for_each(TestCell::stop);
    }
}

/// Returns a path as an argument.
pub(super) fn path(file: &Path) -> String {
    file.display().to_string()
}
