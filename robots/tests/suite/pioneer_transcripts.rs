//! The emulator answers what other clients sent, the driver reads what another server sent. The transcripts lie outside
//! of this tree; without them the tests say so and pass.

use crate::transcripts::{Entry, read};
use wheelwright_core::robot::{Live, RobotConfig};
use wheelwright_robots::SimulatorConfig;
use wheelwright_robots::emulator::{PioneerEmulator, PioneerServer, Protocol};
use wheelwright_robots::pioneer::command::{Argument, number};
use wheelwright_robots::pioneer::firmware::Firmware;
use wheelwright_robots::pioneer::packet::{Decoder, Packet};
use wheelwright_robots::pioneer::sip::Sip;

const ARIA: &str = "ariacoda_simpleMotion__amrisim_p3dx.hex";
const PLAYER: &str = "player_p2os__amrisim_p3dx.hex";

fn packets(bytes: &[u8]) -> Vec<Packet> {
    let mut decoder = Decoder::default();
    decoder.push(bytes);
    let found = std::iter::from_fn(|| decoder.next_packet()).collect();
    assert_eq!(decoder.damage(), 0, "every checksum of the transcript is right");
    found
}

fn of_server(entries: &[Entry]) -> Vec<Packet> {
    let bytes: Vec<u8> = entries.iter().filter(|e| !e.from_client).flat_map(|e| e.bytes.clone()).collect();
    packets(&bytes)
}

#[test]
fn the_driver_reads_another_server() {
    for file in [ARIA, PLAYER] {
        let Some(entries) = read(file) else { return };
        let answers = of_server(&entries);
        assert_eq!(answers[..2].iter().map(|p| p.kind).collect::<Vec<_>>(), [number::SYNC0, number::SYNC1]);
        assert_eq!(answers[2].data, b"AMRISim\0Pioneer\0p3dx\0");
        let sips: Vec<Sip> = answers[3..].iter().filter_map(Sip::decode).collect();
        assert!(sips.len() > 100 && sips.len() + 4 >= answers.len(), "{} of {}", sips.len(), answers.len());
        assert!(sips.iter().any(|s| s.motors_on()) && sips.iter().all(|s| (s.volts() - 13.0).abs() < 1e-9));
        // Positions are wheel speeds summed up, at 0.485 mm a unit.
        let driven: f64 = sips.iter().map(|s| 0.1 * 0.5 * f64::from(s.left + s.right) / 0.485).sum();
        let along: f64 = sips.windows(2).map(|w| f64::from(w[1].x - w[0].x).hypot(f64::from(w[1].y - w[0].y))).sum();
        assert!((along - driven.abs()).abs() < 0.1 * along, "{file}: {along} units of position, {driven} of speed");
    }
    let Some(entries) = read(ARIA) else { return };
    let firmware = of_server(&entries).iter().find_map(Firmware::decode).unwrap();
    assert_eq!(firmware.robot, ["Pioneer", "p3dx", "SIM"]);
    assert_eq!((firmware.cycle, firmware.watchdog, firmware.name.as_str()), (100, 2000, "AMRISim"));
    assert_eq!((firmware.rotation_limit, firmware.translation_limit), (150, 3000));
    assert_eq!((firmware.rotation_ramp, firmware.translation_ramp), ([100, 100], [300, 300]));
}

/// An emulator that states what the server of the transcripts stated.
fn emulator() -> PioneerEmulator {
    let server = PioneerServer { name: "AMRISim".to_owned(), subclass: "p3dx".to_owned(), limits: [3000, 150], ..PioneerServer::default() };
    let simulator = SimulatorConfig::try_from("robot = 'pioneer-3dx'\nperiod = 0.02".parse::<toml::Table>().unwrap()).unwrap();
    PioneerEmulator::new(&server, Live::new(simulator.connect(1).unwrap())).unwrap()
}

/// Plays a client's side to the emulator at its own times; returns the answers.
fn play(entries: &[Entry]) -> Vec<(f64, Packet)> {
    let mut emulator = emulator();
    let (mut decoder, mut answers, mut time) = (Decoder::default(), Vec::new(), 0.0);
    let mut take = |time: f64, bytes: &mut Vec<u8>| {
        decoder.push(bytes);
        bytes.clear();
        while let Some(packet) = decoder.next_packet() {
            answers.push((time, packet));
        }
    };
    let mut bytes = Vec::new();
    for entry in entries.iter().filter(|e| e.from_client) {
        while time + emulator.period() < entry.time {
            emulator.pass(&mut bytes).unwrap();
            time += emulator.period();
            take(time, &mut bytes);
        }
        emulator.receive(&entry.bytes, &mut bytes).unwrap();
        take(time, &mut bytes);
    }
    answers
}

#[test]
fn the_emulator_answers_other_clients_as_their_server_did() {
    for file in [ARIA, PLAYER] {
        let Some(entries) = read(file) else { return };
        let ours = play(&entries);
        let theirs = of_server(&entries);
        for (ours, theirs) in ours[..3].iter().zip(&theirs) {
            assert_eq!(ours.1, *theirs, "{file}: the handshake is the same to the byte");
        }
        let sips: Vec<(f64, Sip)> = ours.iter().filter_map(|(t, p)| Some((*t, Sip::decode(p)?))).collect();
        let expected = of_server(&entries).iter().filter(|p| Sip::decode(p).is_some()).count();
        assert!(sips.len().abs_diff(expected) <= 3, "{file}: {} packets where the server sent {expected}", sips.len());
        for pair in sips.windows(2) {
            assert!((pair[1].0 - pair[0].0 - 0.1).abs() < 1e-6, "a packet every 100 ms");
        }
        // The same layout, byte for byte in length, with and without the sonar.
        let length = |p: &Packet| p.data.len();
        let first = |list: &[Packet]| list.iter().filter(|p| p.kind == 0x32).map(length).next();
        let all: Vec<Packet> = ours.iter().map(|(_, p)| p.clone()).collect();
        assert_eq!(first(&all), first(&theirs), "{file}");
        assert_eq!(all.last().map(length), theirs.last().map(length), "{file}");
    }
}

#[test]
fn the_emulated_robot_drives_as_other_clients_ask() {
    let Some(entries) = read(PLAYER) else { return };
    let ours: Vec<(f64, Sip)> = play(&entries).iter().filter_map(|(t, p)| Some((*t, Sip::decode(p)?))).collect();
    let at = |time: f64| ours.iter().find(|(t, _)| *t >= time).map(|(_, sip)| sip.clone()).unwrap();
    let theirs: Vec<(f64, Sip)> = entries
        .iter()
        .filter(|e| !e.from_client)
        .flat_map(|e| packets(&e.bytes).iter().filter_map(Sip::decode).map(|s| (e.time, s)).collect::<Vec<_>>())
        .collect();
    let of_theirs = |time: f64| theirs.iter().find(|(t, _)| *t >= time).map(|(_, sip)| sip.clone()).unwrap();
    // 200 mm/s straight on, then 60 mm/s on the spot to the left: both robots have settled.
    for time in [5.0, 9.0] {
        let (ours, theirs) = (at(time), of_theirs(time));
        assert!((ours.left - theirs.left).abs() <= 3 && (ours.right - theirs.right).abs() <= 3, "{ours:?}\n{theirs:?}");
        let rotation = |s: &Sip| s.tail.unwrap().rotation.unwrap();
        assert!((rotation(&ours) - rotation(&theirs)).abs() <= 3, "{} and {}", rotation(&ours), rotation(&theirs));
    }
    // 4 s of the same speed cover the same way in the same units.
    let way = |at: &dyn Fn(f64) -> Sip| f64::from(at(5.9).x - at(4.0).x);
    assert!((way(&at) / way(&of_theirs) - 1.0).abs() < 0.07, "{} and {}", way(&at), way(&of_theirs));
}

#[test]
fn commands_of_other_clients_are_understood() {
    let Some(entries) = read(ARIA) else { return };
    let bytes: Vec<u8> = entries.iter().filter(|e| e.from_client).flat_map(|e| e.bytes.clone()).collect();
    let sent = packets(&bytes);
    let values = |kind: u8| sent.iter().filter(|p| p.kind == kind).filter_map(|p| Argument::of(p).integer()).collect::<Vec<_>>();
    assert!(values(number::VEL).contains(&250) && values(number::RVEL).contains(&-10));
    assert_eq!(values(number::SETA), [300, -300]);
}
