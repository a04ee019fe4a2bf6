//! A client as the Java library is one on the wire: unmasked frames, lengths that count characters, no
//! `Sec-WebSocket-Version`, the constant key, two connections, a ping each 2 s on the first. Written from the protocol,
//! not from the gateway. Run by the threads of the test harness.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Time for anything to come. Generous: only a failing test waits so long.
const LIMIT: Duration = Duration::from_secs(60);

/// A message of the server, and when it came.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// When it was read.
    pub at: Instant,
    /// Opcode of its frame.
    pub opcode: u8,
    /// Its payload.
    pub text: String,
}

/// One connection.
pub struct Connection {
    stream: TcpStream,
    heard: Receiver<Heard>,
    /// Everything that came so far, in its order.
    pub log: Vec<Heard>,
    tags: usize,
}

impl Connection {
    /// Connects, upgrades and shakes hands.
    pub fn open(port: u16) -> Connection {
        let mut connection = Connection::upgrade(port);
        let answer = connection.request("ver(\"2.0\")");
        assert_eq!(answer, "ok(\"handshake ok\")");
        connection
    }

    /// Connects and upgrades.
    pub fn upgrade(port: u16) -> Connection {
        let mut stream =
            TcpStream::connect((Ipv4Addr::LOCALHOST, port)).expect("the gateway listens");
        let head = "GET /DirectIO/ HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
                    Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
        stream.write_all(head.as_bytes()).expect("a request");
        let mut reader = BufReader::new(stream.try_clone().expect("a handle"));
        let mut is_accepted = false;
        loop {
            let mut line = String::new();
            reader.read_line(&mut line).expect("the head of an answer");
            assert!(
                !line.is_empty(),
                "the connection was closed in the head of the answer"
            );
            // The library compares the beginning of the line, with these capitals.
            is_accepted |= line.starts_with("Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
            if line.trim_end().is_empty() {
                break;
            }
        }
        assert!(
            is_accepted,
            "no Sec-WebSocket-Accept as the library needs it"
        );
        // The library loses what its buffered reader has read behind the head.
        assert!(
            reader.buffer().is_empty(),
            "sent before the client's first frame"
        );
        let (sender, heard) = channel();
        std::thread::spawn(move || {
            while let Some(heard) = read_frame(&mut reader) {
                if sender.send(heard).is_err() {
                    return;
                }
            }
        });
        Connection {
            stream,
            heard,
            log: Vec::new(),
            tags: 0,
        }
    }

    /// Sends a frame without a mask. The length counts characters.
    pub fn send_frame(&mut self, opcode: u8, text: &str) {
        let mut frame = vec![0x80 | opcode];
        match text.chars().count() {
            short @ 0..=125 => frame.push(short as u8),
            medium @ 126..=0xffff => {
                frame.push(126);
                frame.extend((medium as u16).to_be_bytes());
            }
            long => {
                frame.push(127);
                frame.extend((long as u64).to_be_bytes());
            }
        }
        frame.extend(text.as_bytes());
        self.stream.write_all(&frame).expect("the gateway reads");
    }

    /// Sends bytes as they are; false if the connection is closed.
    pub fn try_send_raw(&mut self, bytes: &[u8]) -> bool {
        self.stream.write_all(bytes).is_ok()
    }

    /// Sends a request; returns its tag.
    pub fn ask(&mut self, request: &str) -> String {
        let tag = format!("c{}", self.tags);
        self.tags += 1;
        self.send_frame(1, &format!("{tag}={request}"));
        tag
    }

    /// Sends a request and returns its answer.
    pub fn request(&mut self, request: &str) -> String {
        let tag = self.ask(request);
        self.answer(&tag)
    }

    /// Waits for the answer to the request with this tag.
    pub fn answer(&mut self, tag: &str) -> String {
        let [ok, err] = ["ok(", "err("].map(|what| format!("{tag}={what}"));
        let heard = self.hear(tag, |text| text.starts_with(&ok) || text.starts_with(&err));
        heard.text[tag.len() + 1..].to_owned()
    }

    /// Waits for the push `what` with this tag.
    pub fn push(&mut self, tag: &str, what: &str) -> Heard {
        let text = format!("{tag}={what}");
        self.hear(&text, |heard| heard.starts_with(&text))
    }

    /// Waits for a message, which may have come already.
    pub fn hear(&mut self, what: &str, is_it: impl Fn(&str) -> bool) -> Heard {
        let begun = Instant::now();
        let mut next = 0;
        loop {
            if let Some(found) = self.log[next..].iter().find(|heard| is_it(&heard.text)) {
                return found.clone();
            }
            next = self.log.len();
            let left = LIMIT.saturating_sub(begun.elapsed());
            match self.heard.recv_timeout(left) {
                Ok(heard) => self.log.push(heard),
                Err(error) => panic!("waiting for {what}: {error}\n{:#?}", self.last()),
            }
        }
    }

    /// Takes in what has come, without waiting.
    pub fn listen(&mut self) {
        self.log.extend(self.heard.try_iter());
    }

    /// Takes in what comes within a time in which nothing wrong may come.
    pub fn listen_for(&mut self, time: Duration) {
        let begun = Instant::now();
        while let Ok(heard) = self
            .heard
            .recv_timeout(time.saturating_sub(begun.elapsed()))
        {
            self.log.push(heard);
        }
    }

    /// Waits until the gateway closes the connection.
    pub fn await_end(&mut self) {
        loop {
            match self.heard.recv_timeout(LIMIT) {
                Ok(heard) => self.log.push(heard),
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => panic!("the connection stays open"),
            }
        }
    }

    /// Returns what came with this tag, without the tag.
    pub fn with_tag(&self, tag: &str) -> Vec<Heard> {
        let begin = format!("{tag}=");
        let of_tag = self
            .log
            .iter()
            .filter(|heard| heard.text.starts_with(&begin));
        of_tag
            .map(|heard| Heard {
                text: heard.text[begin.len()..].to_owned(),
                ..heard.clone()
            })
            .collect()
    }

    /// Closes the connection without a word, as a process does that dies.
    pub fn die(&self) {
        let _ = self.stream.shutdown(Shutdown::Both);
    }

    fn last(&self) -> &[Heard] {
        &self.log[self.log.len().saturating_sub(20)..]
    }
}

fn read_frame(reader: &mut impl Read) -> Option<Heard> {
    let mut head = [0; 2];
    reader.read_exact(&mut head).ok()?;
    assert!(head[0] & 0x80 != 0, "the library appends fragments twice");
    assert!(head[1] & 0x80 == 0, "frames of the server are not masked");
    let mut length = u64::from(head[1] & 0x7f);
    if length >= 126 {
        let mut bytes = [0; 8];
        let count = if length == 126 { 2 } else { 8 };
        reader.read_exact(&mut bytes[8 - count..]).ok()?;
        length = u64::from_be_bytes(bytes);
    }
    let mut payload = vec![0; length as usize];
    reader.read_exact(&mut payload).ok()?;
    let text = String::from_utf8(payload).expect("texts are ASCII");
    assert!(text.is_ascii(), "{text}");
    // The library reads an empty text back as two quotes.
    assert!(
        !text.contains("(\"\"") && !text.contains(":\"\""),
        "an empty text: {text}"
    );
    Some(Heard {
        at: Instant::now(),
        opcode: head[0] & 0x0f,
        text,
    })
}

/// A client with its two connections.
pub struct Client {
    /// The port of the gateway.
    pub port: u16,
    /// First connection.
    pub control: Connection,
    /// Second connection.
    pub data: Connection,
    /// Name of the session.
    pub session: String,
    /// Tag of the devices.
    pub devices: String,
}

/// A net with its subscription.
#[derive(Clone, Debug)]
pub struct LoadedNet {
    /// Its name.
    pub name: String,
    /// Tag of its pushes.
    pub tag: String,
}

impl Client {
    /// Connects as the library does: control, data, session, devices.
    pub fn connect(port: u16) -> Client {
        let mut control = Connection::open(port);
        let mut data = Connection::open(port);
        let session = text_of(&control.request("nse(\"MyApplication@host\")"));
        let devices = data.ask("gde()");
        assert_eq!(data.answer(&devices), "ok()");
        Client {
            port,
            control,
            data,
            session,
            devices,
        }
    }

    /// Loads a net; returns the answer.
    pub fn load_any(&mut self, net: &str) -> String {
        let (net, session) = (quoted(net), &self.session);
        self.control.request(&format!(
            "nene({net},\"{session}\",\"a description\",0.0,1)"
        ))
    }

    /// Loads a net and subscribes to it.
    pub fn load(&mut self, net: &str) -> LoadedNet {
        let answer = self.load_any(net);
        assert!(answer.starts_with("ok("), "{answer}");
        self.subscribe(&text_of(&answer))
    }

    /// Subscribes to a net and waits for its first state.
    pub fn subscribe(&mut self, name: &str) -> LoadedNet {
        let tag = self.data.ask(&format!("gne(\"{name}\",0.02)"));
        assert_eq!(self.data.answer(&tag), "ok()");
        self.data.push(&tag, "ns(");
        LoadedNet {
            name: name.to_owned(),
            tag,
        }
    }

    /// Adds a rule; returns its answer.
    pub fn rule_any(&mut self, condition: &str, [stop, cancel, start]: [&[&str]; 3]) -> String {
        let list = |nets: &[&str]| {
            nets.iter()
                .map(|net| quoted(net))
                .collect::<Vec<_>>()
                .join(",")
        };
        let (stop, cancel, start) = (list(stop), list(cancel), list(start));
        self.control.request(&format!(
            "nesc(\"{condition}\",[{stop}],[{cancel}],[{start}])"
        ))
    }

    /// Adds a rule and subscribes to it; returns the tag.
    pub fn rule(&mut self, condition: &str, nets: [&[&str]; 3]) -> String {
        let answer = self.rule_any(condition, nets);
        assert!(answer.starts_with("ok(\""), "{condition}: {answer}");
        let tag = self
            .data
            .ask(&format!("gsy({})", quoted(&text_of(&answer))));
        assert_eq!(self.data.answer(&tag), "ok()");
        tag
    }

    /// Starts a net as the library does, with the rules that end it by its results; returns the tag of the start rule.
    pub fn start(&mut self, net: &LoadedNet, ends: &[&str]) -> String {
        let name = net.name.as_str();
        for end in ends {
            self.rule(&format!("{name}.{end}"), [&[name], &[], &[]]);
        }
        self.rule("t", [&[], &[], &[name]])
    }

    /// Evaluates a net; returns the document.
    pub fn evaluate(&self, net: &str) -> String {
        let mut encoded = String::new();
        for byte in net.bytes() {
            match byte {
                b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' => encoded.push(byte as char),
                b' ' => encoded.push('+'),
                other => encoded.push_str(&format!("%{other:02X}")),
            }
        }
        let (status, text) = post(self.port, "/eval/", &format!("dionet={encoded}"));
        assert_eq!(status, 200, "{text}");
        text
    }

    /// Creates a device and waits until it can be used.
    pub fn create(&mut self, name: &str, rest: &str) {
        let (status, text) = post(self.port, "//devices/", &format!("name={name}&{rest}"));
        assert_eq!(status, 201, "{text}");
        self.await_device(name, "op");
    }

    /// Waits until a device has this state.
    pub fn await_device(&mut self, name: &str, state: &str) {
        let begin = format!("{}=ds({{", self.devices);
        let wanted = format!("{name}:\"{state}\"");
        self.data.hear(&wanted, |text| {
            text.starts_with(&begin) && text.contains(&wanted)
        });
    }

    /// Waits for the end of a net; returns all that was pushed of it.
    pub fn await_end(&mut self, net: &LoadedNet) -> Vec<Heard> {
        let [terminated, error] =
            ["TERMINATED", "ERROR"].map(|state| format!("{}=ns(\"{state}\")", net.tag));
        self.data
            .hear(&terminated, |text| text == terminated || text == error);
        self.data.with_tag(&net.tag)
    }
}

/// Sends a request with a body over a connection of its own; returns status and body.
pub fn post(port: u16, path: &str, body: &str) -> (u16, String) {
    let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).expect("the gateway listens");
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Type: application/x-www-form-urlencoded\r\nContent-Length: {}\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes()).expect("a head");
    stream.write_all(body.as_bytes()).expect("a body");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
    let status = head
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    (status.expect("a status"), body.to_owned())
}

/// Returns a text in quotes.
pub fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// Returns the text of `ok("text")`.
pub fn text_of(answer: &str) -> String {
    let inner = answer
        .strip_prefix("ok(\"")
        .and_then(|rest| rest.strip_suffix("\")"));
    inner.unwrap_or_else(|| panic!("{answer}")).to_owned()
}
