use proptest::prelude::*;

use super::*;
use crate::test_decoding::*;

/// Position of a base (1005): the frame in the tests of RTKLIB, GNSS-SDR and others.
const RTCM_1005: &str = "d300133ed7d30202980edeef34b4bd62ac0941986f33360b98";
/// What a Trimble caster replied, as the test of a public Java program has it, and a chunk of it with
/// messages 1012, 1007, 1033.
const TRIMBLE_REPLY: &str = "HTTP/1.1 200 OK\r\nNtrip-Version: Ntrip/2.0\r\nConnection: close\r\n\
    Transfer-Encoding: chunked\r\nServer: NTRIP Trimble Ntrip Caster 4.7\r\n\
    Ntrip-Flags: st_match,st_strict,rtsp,plain_rtp\r\nContent-Type: gnss/data\r\n\
    Date: Fri, 04 Aug 2023 15:02:09 UTC\r\nCache-Control: no-store\r\nPragma: no-cache\r\n\r\nED\r\n";
const TRIMBLE_CHUNK: &str = "d3007a3f40057bd914038041af3ab0012317fa3c2402705f3fff641996002f207650fe8309\
    001027703fe3086e35e02417c1ffa4b740a907a7bff3c48a722e0afe0f7fe9ac101e7f62c7fcfa25f03f42bf08cffa3b\
    b4065fa705ff709091be85f01771fe8309ffd40849bfdfa65122a40409bb3fa39b7ffe0342fff5406d1e22d300193ef0\
    05144144564e554c4c414e54454e4e4120204e4f4e4500ba4adfd30048409005144144564e554c4c414e54454e4e4120\
    204e4f4e4500000d5452494d424c4520414c4c4f59144e617620362e3136202f20426f6f7420352e35360a3630323452\
    34303037393e9867";

fn base_position() -> Message {
    Message::Rtcm(Rtcm {
        number: 1005,
        frame: hex(RTCM_1005),
    })
}

/// With a right CRC.
fn rtcm(payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u16).to_be_bytes();
    let bytes = [&[RTCM_MARK], &length[..], payload].concat();
    let sum = crc(&bytes).to_be_bytes();
    [&bytes[..], &sum[1..]].concat()
}

fn chunk(bytes: &[u8]) -> Vec<u8> {
    let length = format!("{:x}\r\n", bytes.len());
    [length.as_bytes(), bytes, b"\r\n"].concat()
}

fn numbers(messages: &[Message]) -> Vec<u16> {
    let number = |message: &Message| match message {
        Message::Rtcm(rtcm) => Some(rtcm.number),
        _ => None,
    };
    messages.iter().filter_map(number).collect()
}

#[test]
fn requests() {
    let login = Some(("user", "pass word"));
    assert_eq!(
        request(Version::Two, "caster.example:2101", "MOUNT", login).unwrap(),
        b"GET /MOUNT HTTP/1.1\r\nHost: caster.example:2101\r\nNtrip-Version: Ntrip/2.0\r\n\
        User-Agent: NTRIP Foreshore\r\nAuthorization: Basic dXNlcjpwYXNzIHdvcmQ=\r\n\
        Connection: close\r\n\r\n"
    );
    assert_eq!(
        request(Version::One, "caster.example", "MOUNT", None).unwrap(),
        b"GET /MOUNT HTTP/1.0\r\nUser-Agent: NTRIP Foreshore\r\nConnection: close\r\n\r\n"
    );
    for (host, mountpoint, user) in [
        ("", "M", "u"),
        ("c", "", "u"),
        ("c\r\nX: y", "M", "u"),
        ("c", "M HTTP/1.1\r\n", "u"),
        ("c", "M", "a:b"),
    ] {
        assert_eq!(
            request(Version::Two, host, mountpoint, Some((user, ""))),
            None
        );
    }
}

#[test]
fn position_reports() {
    let fix = GeodeticFix {
        latitude_deg: 48.1173,
        longitude_deg: -11.516_666_666_7,
        altitude_m: 545.44,
        status: 0,
        sigma_m: None,
    };
    let sentence = b"$GPGGA,123519.50,4807.03800,N,01131.00000,W,1,10,1.0,545.4,M,0.0,M,,*44\r\n";
    let report = position_report(&fix, 45_319.5).unwrap();
    assert_eq!(
        String::from_utf8_lossy(&report),
        String::from_utf8_lossy(sentence)
    );
    // Just below a whole degree and a whole minute.
    let edge = GeodeticFix {
        latitude_deg: -0.999_999_999_9,
        longitude_deg: 179.999_999_999_9,
        altitude_m: f64::NAN,
        ..fix
    };
    let report = String::from_utf8(position_report(&edge, 86_399.999).unwrap()).unwrap();
    let expected = "$GPGGA,235959.99,0100.00000,S,18000.00000,E,1,10,1.0,0.0,M,0.0,M,,*";
    assert!(report.starts_with(expected), "{report}");
    for bad in [
        GeodeticFix { status: -1, ..fix },
        GeodeticFix {
            latitude_deg: f64::NAN,
            ..fix
        },
        GeodeticFix {
            longitude_deg: 181.0,
            ..fix
        },
    ] {
        assert_eq!(position_report(&bad, 0.0), None);
    }
    for time_s in [-1.0, 86_400.0, f64::NAN] {
        assert_eq!(position_report(&fix, time_s), None);
    }
}

#[test]
fn a_reply_of_a_real_caster() {
    let chunk = hex(TRIMBLE_CHUNK);
    let bytes = [TRIMBLE_REPLY.as_bytes(), &chunk, b"\r\n"].concat();
    for length in [1, 7, usize::MAX] {
        let (messages, dropped) = decode_in(NtripDecoder::default(), &bytes, &[length]);
        assert_eq!(dropped, Dropped::default());
        assert_eq!(messages[0], Message::Accepted);
        assert_eq!(numbers(&messages), [1012, 1007, 1033]);
        let frames = messages.iter().filter_map(|message| match message {
            Message::Rtcm(rtcm) => Some(rtcm.frame.clone()),
            _ => None,
        });
        assert_eq!(frames.collect::<Vec<_>>().concat(), chunk);
    }
}

#[test]
fn replies() {
    let frame = hex(RTCM_1005);
    let accepted = vec![Message::Accepted, base_position()];
    let refused = |line: &str| vec![Message::Refused(line.into())];
    let v2 = "HTTP/1.1 200 OK\r\nTransfer-Encoding: Chunked\r\n\r\n";
    let parts = [v2.as_bytes(), &chunk(&frame[..9]), &chunk(&frame[9..])].concat();
    for (reply, expected) in [
        (
            [&b"ICY 200 OK\r\n"[..], &frame[..]].concat(),
            accepted.clone(),
        ),
        (
            [&b"ICY 200 OK\r\n\r\n"[..], &frame[..]].concat(),
            accepted.clone(),
        ),
        (
            [&b"ICY 200 OK\r\nServer: x\r\n\r\n"[..], &frame[..]].concat(),
            accepted.clone(),
        ),
        (
            [&b"HTTP/1.1 200 OK\r\n\r\n"[..], &frame[..]].concat(),
            accepted.clone(),
        ),
        (parts.clone(), accepted.clone()),
        (
            [&parts[..], b"0\r\n\r\n"].concat(),
            [&accepted[..], &[Message::Ended]].concat(),
        ),
        (
            [v2.as_bytes(), b"19;name=value\r\n", &frame].concat(),
            accepted,
        ),
        (
            b"HTTP/1.1 401 Unauthorized\r\n\r\n".to_vec(),
            refused("HTTP/1.1 401 Unauthorized"),
        ),
        (
            b"SOURCETABLE 200 OK\r\nSTR;BASE;\r\nENDSOURCETABLE\r\n".to_vec(),
            refused("SOURCETABLE 200 OK"),
        ),
        (
            b"HTTP/1.1 200 OK\r\nContent-Type: gnss/sourcetable\r\n\r\nSTR;".to_vec(),
            refused("content-type: gnss/sourcetable"),
        ),
        (
            b"ERROR - Bad Password\r\n".to_vec(),
            refused("ERROR - Bad Password"),
        ),
    ] {
        for length in [1, 5, usize::MAX] {
            let (messages, _) = decode_in(NtripDecoder::default(), &reply, &[length]);
            assert_eq!(messages, expected, "{}", String::from_utf8_lossy(&reply));
        }
    }
}

#[test]
fn damaged_corrections_are_dropped_and_the_next_are_found() {
    let frame = hex(RTCM_1005);
    let mut wrong_crc = frame.clone();
    wrong_crc[10] ^= 1;
    for (bad, reason, count) in [
        (b"xyz".to_vec(), DropReason::Garbage, 3),
        (vec![RTCM_MARK, 0x04, 0], DropReason::Length, 1),
        (wrong_crc, DropReason::Checksum, 1),
        (frame[..20].to_vec(), DropReason::Checksum, 1),
        // Filling is no drop.
        (hex("d3000047ea4b"), DropReason::Garbage, 0),
    ] {
        let bytes = [&b"ICY 200 OK\r\n\r\n"[..], &bad[..], &frame, &frame].concat();
        for length in [1, 6, usize::MAX] {
            let (messages, dropped) = decode_in(NtripDecoder::default(), &bytes, &[length]);
            assert_eq!(numbers(&messages), [1005, 1005], "{bad:x?}");
            assert_eq!(dropped.count(reason), count, "{bad:x?} {dropped:?}");
        }
    }
}

#[test]
fn damaged_chunks_end_the_corrections() {
    let frame = hex(RTCM_1005);
    for bad in [&b"x\r\n"[..], b"\r\n", b"-1\r\n", b"10000000000000000\r\n"] {
        let reply = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n";
        let bytes = [&reply[..], &chunk(&frame), bad, &frame].concat();
        let (messages, dropped) = decode(NtripDecoder::default(), &bytes);
        assert_eq!(
            messages,
            [Message::Accepted, base_position(), Message::Ended]
        );
        assert_eq!(dropped.count(DropReason::Field), 1);
    }
    // A chunk that does not end where it said.
    let bytes = [TRIMBLE_REPLY.as_bytes(), &[0; 0xED], b"xx\r\n"].concat();
    let (messages, _) = decode(NtripDecoder::default(), &bytes);
    assert_eq!(messages, [Message::Accepted, Message::Ended]);
    // A header line without an end.
    let (messages, dropped) = decode(NtripDecoder::default(), &[b'x'; 3000]);
    assert_eq!((messages.len(), dropped.count(DropReason::Length)), (0, 2));
}

proptest! {
    #[test]
    fn corrections_come_through_in_any_chunks_and_reads(
        payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 2..300), 1..10),
        chunk_lengths in prop::collection::vec(1..400_usize, 1..10),
        lengths in read_lengths(),
    ) {
        let frames: Vec<u8> = payloads.iter().flat_map(|payload| rtcm(payload)).collect();
        let mut bytes = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n".to_vec();
        let mut rest = &frames[..];
        for length in chunk_lengths.iter().cycle() {
            let (piece, after) = rest.split_at((*length).min(rest.len()));
            bytes.extend(chunk(piece));
            rest = after;
            if rest.is_empty() {
                break;
            }
        }
        bytes.extend(chunk(&[]));
        let (messages, dropped) = decode_in(NtripDecoder::default(), &bytes, &lengths);
        prop_assert_eq!(dropped, Dropped::default());
        prop_assert_eq!(messages.len(), payloads.len() + 2);
        for (message, payload) in messages[1..].iter().zip(&payloads) {
            let Message::Rtcm(rtcm) = message else { panic!("{message:?}") };
            prop_assert_eq!(&rtcm.frame[3..rtcm.frame.len() - 3], payload);
        }
        prop_assert_eq!(messages.last(), Some(&Message::Ended));
    }

    #[test]
    fn damage_neither_panics_nor_gives_wrong_corrections(
        is_chunked in any::<bool>(),
        count in 0..8_usize,
        damage in damage(b"\xD3\x00\r\n:0a"),
    ) {
        let frames = hex(RTCM_1005).repeat(count);
        let bytes = if is_chunked {
            [TRIMBLE_REPLY.as_bytes(), &hex(TRIMBLE_CHUNK), b"\r\n", &chunk(&frames)].concat()
        } else {
            [&b"ICY 200 OK\r\n"[..], &frames[..]].concat()
        };
        for message in damage.decode(NtripDecoder::default, bytes) {
            if let Message::Rtcm(rtcm) = message {
                prop_assert_eq!(crc(&rtcm.frame), 0);
            }
        }
    }
}
