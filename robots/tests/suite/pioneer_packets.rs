//! The packet codec against captured bytes of third parties, and against any bytes at all.

use proptest::prelude::*;
use wheelwright_robots::pioneer::command::{self, Argument, number};
use wheelwright_robots::pioneer::firmware::Firmware;
use wheelwright_robots::pioneer::packet::{Decoder, MOST_DATA, Packet, encode};
use wheelwright_robots::pioneer::sip::{Sip, Tail, encoder_ticks};

fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|b| u8::from_str_radix(b, 16).unwrap()).collect()
}

fn packets(bytes: &[u8]) -> (Vec<Packet>, u64) {
    let mut decoder = Decoder::default();
    decoder.push(bytes);
    let packets = std::iter::from_fn(|| decoder.next_packet()).collect();
    (packets, decoder.damage())
}

#[test]
fn commands_are_byte_for_byte_those_of_other_clients() {
    // Captured from ARIA and from Player.
    let cases = [
        (command::plain(number::SYNC0), "fa fb 03 00 00 00"),
        (command::plain(number::SYNC1), "fa fb 03 01 00 01"),
        (command::plain(number::SYNC2), "fa fb 03 02 00 02"),
        (command::integer(number::OPEN, 1), "fa fb 06 01 3b 01 00 02 3b"),
        (command::integer(number::CONFIG, 1), "fa fb 06 12 3b 01 00 13 3b"),
        (command::integer(number::SETA, 300), "fa fb 06 05 3b 2c 01 31 3c"),
        (command::integer(number::SETA, -300), "fa fb 06 05 1b 2c 01 31 1c"),
        (command::integer(number::ENABLE, 1), "fa fb 06 04 3b 01 00 05 3b"),
        (command::integer(number::VEL, 250), "fa fb 06 0b 3b fa 00 05 3b"),
        (command::integer(number::RVEL, -10), "fa fb 06 15 1b 0a 00 1f 1b"),
        (command::integer(number::SONAR, 0), "fa fb 06 1c 3b 00 00 1c 3b"),
        (command::vel2(10, 10), "fa fb 06 20 3b 0a 0a 2a 45"),
        (command::vel2(-3, 3), "fa fb 06 20 3b 03 fd 24 38"),
    ];
    for (ours, theirs) in cases {
        assert_eq!(ours, hex(theirs));
    }
}

#[test]
fn the_answer_to_sync2_holds_three_names() {
    let (found, damage) = packets(&hex("fa fb 18 02 41 4d 52 49 53 69 6d 00 50 69 6f 6e 65 65 72 00 70 33 64 78 00 eb bd"));
    assert_eq!((found.len(), damage, found[0].kind), (1, 0, 2));
    assert_eq!(found[0].data, b"AMRISim\0Pioneer\0p3dx\0");
}

#[test]
fn an_information_packet_is_read_by_its_offsets() {
    // A turn on the spot with the sonar off.
    let bytes = hex("fa fb 26 32 dd 05 00 00 60 03 c5 ff 3b 00 82 00 00 00 00 01 00 00 00 00 00 00 ff ff 82 00 00 be 00 00 00 00 00 81 00");
    let sip = Sip::decode(&Packet { kind: bytes[3], data: bytes[4..].to_vec() }).unwrap();
    assert_eq!((sip.x, sip.y, sip.heading, sip.left, sip.right), (1501, 0, 864, -59, 59));
    assert_eq!((sip.battery, sip.flags, sip.sonar.len()), (130, 1, 0));
    let tail = sip.tail.unwrap();
    assert_eq!((tail.battery, tail.rotation), (130, Some(190)));
    assert!(sip.motors_on() && (sip.volts() - 13.0).abs() < 1e-12);
    // AmigoBots and P2OS end before the tail.
    let short = Packet { kind: 0x33, data: bytes[4..4 + 24].to_vec() };
    let sip = Sip::decode(&short).unwrap();
    assert!(sip.moving && sip.tail.is_none() && sip.right == 59);
}

#[test]
fn a_wrong_checksum_costs_one_packet_and_no_more() {
    let good = command::integer(number::VEL, 250);
    let mut bad = good.clone();
    *bad.last_mut().unwrap() ^= 1;
    // A false header that claims 255 bytes hides nothing once they have come.
    let stream = [&good[..], &bad, &good, &hex("00 fa fa fb ff 01"), &good.repeat(40), &good[..4]].concat();
    let (found, damage) = packets(&stream);
    assert_eq!(found.len(), 42);
    assert!(damage > 0 && found.iter().all(|p| Argument::of(p) == Argument::Integer(250)));
}

#[test]
fn two_signed_bytes_may_come_as_a_negative_integer() {
    // -756 is 0xfd0c: 12 to the right, -3 to the left.
    let packet = |bytes: Vec<u8>| packets(&bytes).0.remove(0);
    assert_eq!(Argument::of(&packet(command::integer(number::VEL2, -756))).bytes(), Some([12, -3]));
    assert_eq!(Argument::of(&packet(command::vel2(-3, 12))).bytes(), Some([12, -3]));
    assert_eq!(Argument::of(&packet(hex("fa fb 04 07 3b 07 3b"))), Argument::None, "Player's SETO has a type and no value");
}

fn sip() -> impl Strategy<Value = Sip> {
    let tail = (any::<i16>(), any::<u8>(), any::<i16>(), any::<u16>()).prop_map(|(battery, charge, rotation, faults)| Tail {
        battery,
        charge,
        rotation: Some(rotation),
        faults: Some(faults),
    });
    let sonar = proptest::collection::vec(any::<(u8, u16)>(), 0..40);
    (any::<([i16; 6], [u16; 2], [u8; 2], bool)>(), sonar, proptest::option::of(tail)).prop_map(
        |(([x, y, heading, left, right, control], [stall, flags], [battery, compass], moving), sonar, tail)| Sip {
            moving,
            x,
            y,
            heading,
            left,
            right,
            battery,
            stall,
            control,
            flags,
            compass,
            sonar,
            tail,
        },
    )
}

proptest! {
    #[test]
    fn a_packet_comes_back_as_it_went(kind: u8, data in proptest::collection::vec(any::<u8>(), 0..=MOST_DATA), cut in 0..260_usize) {
        let bytes = encode(kind, &data);
        let (first, second) = bytes.split_at(cut.min(bytes.len()));
        let mut decoder = Decoder::default();
        decoder.push(first);
        let early = decoder.next_packet();
        decoder.push(second);
        prop_assert_eq!(early.or_else(|| decoder.next_packet()), Some(Packet { kind, data }));
        prop_assert_eq!(decoder.damage(), 0);
    }

    #[test]
    fn an_information_packet_comes_back_as_it_went(sip in sip()) {
        let packet = sip.encode();
        let (found, _) = packets(&encode(packet.kind, &packet.data));
        prop_assert_eq!(Sip::decode(&found[0]), Some(sip));
    }

    #[test]
    fn a_configuration_comes_back_as_it_went(
        names in proptest::array::uniform5("[a-zA-Z0-9 .-]{0,12}"), words in proptest::array::uniform16(any::<u16>()), cycle: u8
    ) {
        let [kind, subtype, serial, name, version] = names;
        let [a, b, c, d, watchdog, e, f, g, h, i, j, k, l, m, n, o] = words;
        let firmware = Firmware {
            robot: [kind, subtype, serial], rotation_top: a, translation_top: b, rotation_acceleration_top: c,
            translation_acceleration_top: d, name, cycle, watchdog, rotation_limit: e, translation_limit: f, rotation_ramp: [g, h],
            rotation_gains: [i, j, k], translation_ramp: [l, m], translation_gains: [n, o, a], ticks_per_mm: b, version,
        };
        prop_assert_eq!(Firmware::decode(&firmware.encode()), Some(firmware));
    }

    #[test]
    fn an_integer_comes_back_as_it_went(number: u8, value in -65_535..=65_535_i32) {
        let (found, _) = packets(&command::integer(number, value));
        prop_assert_eq!(Argument::of(&found[0]).integer(), Some(value));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]
    #[test]
    fn no_bytes_break_the_decoders(bytes in noisy(), step in 1..64_usize) {
        let mut decoder = Decoder::default();
        for chunk in bytes.chunks(step) {
            decoder.push(chunk);
            while let Some(packet) = decoder.next_packet() {
                read_every_way(&packet);
            }
        }
    }

    #[test]
    fn any_packet_can_be_read_every_way(kind: u8, data in proptest::collection::vec(any::<u8>(), 0..252)) {
        for kind in [kind, 0x32, 0x20, 0x90] {
            read_every_way(&Packet { kind, data: data.clone() });
        }
    }

    #[test]
    fn packets_after_garbage_are_found(garbage in noisy(), data in proptest::collection::vec(any::<u8>(), 0..100)) {
        let good = encode(0x32, &data);
        let (found, _) = packets(&[garbage, good.repeat(300)].concat());
        let wanted = Packet { kind: 0x32, data };
        // A false packet with a right checksum may hide some of the good ones; what follows is whole.
        prop_assert!(found.iter().filter(|p| **p == wanted).count() >= 300 - 256 / good.len() - 1);
        prop_assert_eq!(found.last(), Some(&wanted));
    }
}

/// Bytes in which headers are frequent.
fn noisy() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![4 => any::<u8>(), 1 => Just(0xFA), 1 => Just(0xFB), 1 => 0..8_u8];
    proptest::collection::vec(byte, 0..400)
}

fn read_every_way(packet: &Packet) {
    let _ = (Sip::decode(packet), Firmware::decode(packet), encoder_ticks(packet), Argument::of(packet));
}
