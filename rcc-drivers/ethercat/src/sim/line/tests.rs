//! A line of four terminals, frame by frame, without a network.

use super::*;
use crate::sim::model::MODELS;
use crate::sim::state_machine::{State, Status, code};

const APRD: u8 = 1;
const APWR: u8 = 2;
const FPRD: u8 = 4;
const FPWR: u8 = 5;
const BRD: u8 = 7;
const BWR: u8 = 8;
const LRW: u8 = 12;
const FRMW: u8 = 14;

const START: Duration = Duration::from_secs(1);

fn line() -> Line {
    Line::new(&MODELS.iter().take(4).collect::<Vec<_>>())
}

/// Sends one datagram; returns its data and its working counter.
fn send(line: &mut Line, now: Duration, datagram: (u8, u32, &[u8])) -> (Vec<u8>, u16) {
    let mut packet = frame::build(&[datagram]);
    assert_eq!(line.exchange(&mut packet, now), Ok(true));
    let end = packet.len() - 2;
    let counter = u16::from_le_bytes([packet[end], packet[end + 1]]);
    (packet[end - datagram.2.len()..end].to_vec(), counter)
}

fn register(station: u16, register: u16) -> u32 {
    u32::from(station) | u32::from(register) << 16
}

fn write(line: &mut Line, station: u16, at: u16, data: &[u8]) -> u16 {
    send(line, START, (FPWR, register(station, at), data)).1
}

fn read(line: &mut Line, station: u16, at: u16, size: usize) -> (Vec<u8>, u16) {
    send(line, START, (FPRD, register(station, at), &vec![0; size]))
}

/// Gives station addresses 0x1001 to 0x1004.
fn address(line: &mut Line) {
    for position in 0..4_u16 {
        let target = register(0_u16.wrapping_sub(position), 0x0010);
        let station = (0x1001 + position).to_le_bytes();
        assert_eq!(send(line, START, (APWR, target, &station)).1, 1);
    }
}

/// Writes sync managers as the EEPROM describes them and one FMMU for the process data, then requests each state.
fn configure(line: &mut Line, position: u16, logical: u32) {
    let station = 0x1001 + position;
    let model = MODELS[usize::from(position)];
    for (number, manager) in (0..).zip(model.sync_managers()) {
        let mut bytes = manager.start.to_le_bytes().to_vec();
        bytes.extend(manager.length.to_le_bytes());
        bytes.extend([manager.control, 0, u8::from(manager.length > 0), 0]);
        write(line, station, 0x0800 + number * 8, &bytes);
    }
    let manager = model.outputs_manager().or(model.inputs_manager());
    let (_, manager) = manager.expect("process data");
    let mut bytes = logical.to_le_bytes().to_vec();
    bytes.extend(manager.length.to_le_bytes());
    bytes.extend([0, 7]);
    bytes.extend(manager.start.to_le_bytes());
    bytes.extend([0, if model.has_outputs() { 2 } else { 1 }, 1, 0, 0, 0]);
    write(line, station, 0x0600, &bytes);
    for state in [2, 4, 8] {
        assert_eq!(write(line, station, 0x0120, &[state, 0]), 1);
        let status = read(line, station, 0x0130, 2).0;
        assert_eq!(status, [state, 0], "{} into {state}", model.name);
    }
}

/// All four in OP; logical bytes: 0 inputs, 1 outputs, 2 to 17 analog inputs, 18 to 25 analog outputs.
fn running() -> Line {
    let mut line = line();
    address(&mut line);
    for (position, logical) in [(0, 0), (1, 1), (2, 2), (3, 18)] {
        configure(&mut line, position, logical);
    }
    line
}

#[test]
fn a_broadcast_counts_all_and_combines_what_it_reads() {
    let mut line = line();
    let (data, counter) = send(&mut line, START, (BRD, register(0, 0x0130), &[0, 0]));
    assert_eq!((data, counter), (vec![1, 0], 4));
    address(&mut line);
    let (data, _) = send(&mut line, START, (BRD, register(0, 0x0010), &[0, 0]));
    assert_eq!(data, [0x07, 0x10]);
}

#[test]
fn a_position_addresses_one_and_counts_on() {
    let mut line = line();
    let mut packet = frame::build(&[(APRD, register(0xfffe, 0x0110), &[0, 0])]);
    assert_eq!(line.exchange(&mut packet, START), Ok(true));
    assert_eq!(packet[18..20], [2, 0], "four SubDevices have counted");
    assert_eq!(packet[26..], [0x31, 0x5a, 1, 0]);
    assert_eq!(packet[6], 0x12, "the frame is marked as processed");
    let last = send(&mut line, START, (APRD, register(0xfffd, 0x0110), &[0, 0]));
    assert_eq!(last, (vec![0x11, 0x56], 1));
}

#[test]
fn one_reads_and_the_others_write() {
    let mut line = line();
    address(&mut line);
    write(&mut line, 0x1002, 0x0f10, &[7]);
    let (data, counter) = send(&mut line, START, (FRMW, register(0x1002, 0x0f10), &[0]));
    // The first one has written the 0 that was sent; those behind the reading one got its value.
    assert_eq!((data, counter), (vec![7], 4));
    assert_eq!(read(&mut line, 0x1001, 0x0f10, 1).0, [0]);
    assert_eq!(read(&mut line, 0x1004, 0x0f10, 1).0, [7]);
}

#[test]
fn process_data_flow_both_ways_with_the_right_counter() {
    let mut line = running();
    assert!(line.stations[0].device.set_input(3, 1));
    assert!(line.stations[2].device.set_input(1, -1234));
    assert!(line.stations[2].device.set_input(2, 40_000));
    let mut data = [0; 26];
    data[1] = 0b1010_0001;
    data[20..22].copy_from_slice(&0x7fff_u16.to_le_bytes());
    let (data, counter) = send(&mut line, START, (LRW, 0, &data));
    assert_eq!(counter, 2 + 2 * 2);
    assert_eq!(data[0], 0b1000);
    assert_eq!(data[6..10], [0, 0, 0x2e, 0xfb]);
    assert_eq!(data[10..14], [0x42, 0, 0xff, 0x7f], "overrange is an error");
    let outputs = line.stations[1].device.outputs();
    assert_eq!(outputs, [1, 0, 0, 0, 0, 1, 0, 1]);
    assert_eq!(line.stations[3].device.outputs(), [0, 0x7fff, 0, 0]);
}

#[test]
fn outputs_are_driven_in_op_only() {
    let mut line = running();
    assert_eq!(write(&mut line, 0x1002, 0x0120, &[4, 0]), 1);
    let (_, counter) = send(&mut line, START, (LRW, 1, &[0xff]));
    assert_eq!(counter, 2, "the buffer is written");
    assert_eq!(line.stations[1].device.outputs(), [0; 8]);
    assert_eq!(write(&mut line, 0x1002, 0x0120, &[2, 0]), 1);
    assert_eq!(send(&mut line, START, (LRW, 1, &[0xff])).1, 0);
}

#[test]
fn the_watchdog_switches_off_after_100_ms_without_outputs() {
    let mut line = running();
    send(&mut line, START, (LRW, 1, &[0xff]));
    line.advance(START + Duration::from_millis(99));
    assert_eq!(line.stations[1].device.outputs(), [1; 8]);
    line.advance(START + Duration::from_millis(100));
    assert_eq!(line.stations[1].device.outputs(), [0; 8]);
    assert_eq!(line.stations[1].device.trips(), 1);
    assert_eq!(
        read(&mut line, 0x1002, 0x0130, 6).0[..],
        [0x14, 0, 0, 0, 0x1b, 0]
    );
    assert_eq!(
        line.stations[0].device.status(),
        Status {
            state: State::Op,
            code: 0
        }
    );
}

#[test]
fn outputs_in_time_keep_the_watchdog_away() {
    let mut line = running();
    for step in 0..50 {
        let now = START + Duration::from_millis(90 * step);
        assert_eq!(send(&mut line, now, (LRW, 1, &[0xff])).1, 2);
    }
    assert_eq!(line.stations[1].device.trips(), 0);
}

#[test]
fn a_state_needs_its_sync_managers() {
    let mut line = line();
    address(&mut line);
    for (station, wanted, code) in [
        (0x1003, 2, code::MAILBOX),
        (0x1002, 4, code::OUTPUTS),
        (0x1001, 4, code::INPUTS),
        (0x1001, 8, code::INVALID_STEP),
    ] {
        if wanted == 4 {
            write(&mut line, station, 0x0120, &[2, 0]);
        }
        write(&mut line, station, 0x0120, &[wanted | 0x10, 0]);
        let status = read(&mut line, station, 0x0130, 6).0;
        assert_eq!(status[0] & 0x10, 0x10);
        assert_eq!(u16::from_le_bytes([status[4], status[5]]), code);
    }
}

#[test]
fn the_mailbox_takes_one_message_and_gives_one_answer() {
    let mut line = running();
    let mut message = vec![
        10, 0, 0, 0, 0, 0x13, 0, 0x20, 0x40, 0x18, 0x10, 2, 0, 0, 0, 0,
    ];
    message.resize(128, 0);
    assert_eq!(read(&mut line, 0x1003, 0x1080, 128).1, 0, "it is empty");
    assert_eq!(write(&mut line, 0x1003, 0x1000, &message), 1);
    assert_eq!(read(&mut line, 0x1003, 0x080d, 1).0, [8], "it is full");
    assert_eq!(write(&mut line, 0x1003, 0x1000, &message), 0, "it waits");
    let (answer, counter) = read(&mut line, 0x1003, 0x1080, 128);
    assert_eq!(counter, 1);
    assert_eq!(answer[8..16], [0x43, 0x18, 0x10, 2, 0x52, 0x30, 0xf8, 0x0b]);
    assert_eq!(read(&mut line, 0x1003, 0x080d, 1).0, [0]);
    assert_eq!(read(&mut line, 0x1003, 0x1080, 128).1, 0);
    // The MainDevice has lost the answer and asks for it again.
    assert_eq!(write(&mut line, 0x1003, 0x080e, &[3]), 1);
    assert_eq!(read(&mut line, 0x1003, 0x080f, 1).0, [2]);
    assert_eq!(read(&mut line, 0x1003, 0x1080, 128), (answer, 1));
}

#[test]
fn a_pulled_cable_shortens_the_line_and_no_frame_passes_it() {
    let mut line = running();
    line.pulled = Some(2);
    line.connect();
    assert_eq!(send(&mut line, START, (BRD, 0, &[0])).1, 2);
    assert_eq!(read(&mut line, 0x1002, 0x0110, 2).0, [0x11, 0x56]);
    line.pulled = Some(0);
    let mut packet = frame::build(&[(BWR, register(0, 0x0120), &[1, 0])]);
    assert_eq!(line.exchange(&mut packet, START), Ok(false));
    line.pulled = None;
    line.connect();
    assert_eq!(send(&mut line, START, (BRD, 0, &[0])).1, 4);
    assert_eq!(line.stations[3].device.status().state, State::Op);
}

#[test]
fn a_terminal_without_power_forgets_all_but_what_is_wired_to_it() {
    let mut line = running();
    line.stations[2].device.set_input(0, 77);
    line.stations[2].powered = false;
    assert_eq!(send(&mut line, START, (BRD, 0, &[0])).1, 2);
    line.stations[2].device.restart();
    line.stations[2].powered = true;
    let station = &line.stations[2].device;
    assert_eq!((station.status(), station.station()), (Status::POWER_ON, 0));
    assert_eq!(station.inputs(), [77, 0, 0, 0]);
}

#[test]
fn random_datagrams_never_end_the_line() {
    let mut line = running();
    let mut random = fastrand::Rng::with_seed(4);
    for step in 0..50_000 {
        let data: Vec<u8> = (0..random.usize(0..140)).map(|_| random.u8(..)).collect();
        let register = random.choice([0x0010_u16, 0x0120, 0x0500, 0x0600, 0x0800, 0x1000, 0x1080]);
        let offset = register.unwrap_or(0).wrapping_add(random.u16(0..32));
        let target = random.choice([0_u16, 0x1001, 0x1003, 0xffff]).unwrap_or(0);
        let address = u32::from(target) | u32::from(offset) << 16;
        let now = START + Duration::from_micros(step);
        let packet = &mut frame::build(&[(random.u8(..16), address, &data)]);
        assert_eq!(line.exchange(packet, now), Ok(true));
    }
}
