//! A cable between two hosts that loses, delays, duplicates and reorders Ethernet frames, as real networks do below TCP: two TAP
//! devices, whose frames a thread passes on through the fault proxy.
#![allow(unsafe_code)] // Opening a TAP device has no safe wrapper.

use std::fs::{File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::os::fd::{AsFd as _, AsRawFd as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use nix::poll::{PollFd, PollFlags, poll};
use rcc_driver_kit::proxy::{FaultCounts, FaultRates, FaultyLink};

/// Longest frame: MTU and header.
const FRAME_MAX: usize = 1514;
/// A TAP device whose frames have no further header.
const FLAGS: i16 = (libc::IFF_TAP | libc::IFF_NO_PI) as i16;

type Lines = Mutex<[FaultyLink; 2]>;

/// The cable; unplugged when dropped.
#[derive(Debug)]
pub(super) struct Cable {
    lines: Arc<Lines>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Cable {
    /// Makes two interfaces with these names in the namespace of the caller; the faults are drawn from `seed`.
    pub fn new(ends: &[String; 2], seed: u64) -> Result<Cable, String> {
        let taps = [tap(&ends[0])?, tap(&ends[1])?];
        let lines = [seed, !seed].map(|seed| FaultyLink::new(FaultRates::NONE, seed));
        let lines = Arc::new(Mutex::new(lines));
        let stop = Arc::<AtomicBool>::default();
        let own = (Arc::clone(&lines), Arc::clone(&stop));
        let thread = std::thread::Builder::new().name("cable".into());
        let thread = thread.spawn(move || pass(taps, &own.0, &own.1));
        Ok(Cable {
            lines,
            stop,
            thread: Some(thread.map_err(|error| error.to_string())?),
        })
    }

    /// Sets the fault rates of both directions, from now on; a step is 1 ms.
    pub fn set_rates(&self, rates: FaultRates) {
        lock(&self.lines)
            .iter_mut()
            .for_each(|line| line.set_rates(rates));
    }

    /// Returns the counters of both directions.
    pub fn counts(&self) -> [FaultCounts; 2] {
        lock(&self.lines).each_ref().map(FaultyLink::counts)
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has already been reported.
            drop(thread.join());
        }
    }
}

fn lock(lines: &Lines) -> MutexGuard<'_, [FaultyLink; 2]> {
    lines.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Opens a TAP device, which lives as long as the file.
fn tap(name: &str) -> Result<File, String> {
    let mut options = OpenOptions::new();
    options.read(true).write(true);
    let file = options
        .custom_flags(libc::O_NONBLOCK)
        .open("/dev/net/tun")
        .map_err(|error| format!("needs /dev/net/tun: {error}"))?;
    // SAFETY: zero bytes are a valid `ifreq`.
    let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
    for (to, from) in request.ifr_name.iter_mut().zip(name.bytes()) {
        *to = from as libc::c_char;
    }
    request.ifr_ifru.ifru_flags = FLAGS;
    // SAFETY: the file is open, and the request is an `ifreq` with a name and flags, as TUNSETIFF wants it.
    let done = unsafe { libc::ioctl(file.as_raw_fd(), libc::TUNSETIFF, &raw mut request) };
    match done {
        0 => Ok(file),
        _ => Err(format!("needs TAP devices: {}", nix::Error::last())),
    }
}

/// Passes frames on until it is stopped.
fn pass(mut taps: [File; 2], lines: &Lines, stop: &AtomicBool) {
    let start = Instant::now();
    let mut step = 0;
    let mut frame = [0; FRAME_MAX];
    while !stop.load(Ordering::Relaxed) {
        let mut wait = taps
            .each_ref()
            .map(|tap| PollFd::new(tap.as_fd(), PollFlags::POLLIN));
        // An interrupted wait is a short one.
        let _ = poll(&mut wait, 1_u8);
        let now = start.elapsed().as_millis();
        let mut lines = lock(lines);
        while step < now {
            step += 1;
            lines.iter_mut().for_each(FaultyLink::step);
        }
        for (tap, line) in taps.iter_mut().zip(lines.iter_mut()) {
            // An interface that is not up yet has an error instead of frames.
            while let Ok(size) = tap.read(&mut frame) {
                line.push(&frame[..size]);
            }
        }
        for (tap, line) in taps.iter_mut().rev().zip(lines.iter_mut()) {
            while let Some(bytes) = line.pop() {
                // Lost, if the interface is not up.
                let _ = tap.write(&bytes);
            }
        }
    }
}
