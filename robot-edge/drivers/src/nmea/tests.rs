use std::fs;

use proptest::prelude::*;
use serde_json::Value;

use super::*;
use crate::Dropped;
use crate::shared_data::shared_data;
use crate::test_decoding::*;

/// A whole line of a body.
fn line(body: &str) -> String {
    format!("${body}*{:02X}\r\n", checksum(body.as_bytes()))
}

fn sentence(body: &str) -> Result<Sentence, DropReason> {
    let (messages, dropped) = decode(NmeaDecoder::default(), line(body).as_bytes());
    match messages.into_iter().next() {
        Some(message) => Ok(message.sentence),
        None => Err(dropped.iter().next().unwrap().0),
    }
}

fn close(value: Option<f64>, expected: f64, tolerance: f64) {
    let error = value.map(|value| (value - expected).abs());
    assert!(
        error.is_some_and(|error| error <= tolerance),
        "{value:?} {expected}"
    );
}

/// Values that both gpsd's report and the sentences since its last one have; the number of them.
fn compare(report: &Value, sentences: &[Sentence]) -> usize {
    let mut compared = 0;
    let mut check = |name: &str, value: Option<f64>, tolerance| {
        if let Some(expected) = report.get(name) {
            close(value, expected.as_f64().unwrap(), tolerance);
            compared += 1;
        }
    };
    let seconds = |time_of_day_s: Option<f64>| {
        let time = report["time"].as_str().unwrap();
        let part = |from, to| time[from..to].parse::<f64>().unwrap();
        let expected = (part(11, 13) * 60.0 + part(14, 16)) * 60.0 + part(17, 23);
        close(time_of_day_s, expected, 1e-6);
    };
    for sentence in sentences {
        match sentence {
            Sentence::Gga(gga) => {
                let fix = gga.fix();
                check("lat", fix.map(|fix| fix.latitude_deg), 1e-9);
                check("lon", fix.map(|fix| fix.longitude_deg), 1e-9);
                check("altHAE", fix.map(|fix| fix.altitude_m), 1e-4);
                check("altMSL", gga.altitude_m, 1e-4);
                check("geoidSep", gga.geoid_separation_m, 1e-9);
                check("dgpsAge", gga.correction_age_s, 1e-9);
                check("dgpsSta", gga.base_station.map(f64::from), 0.0);
                let status = match gga.quality {
                    Quality::Differential => Some(2),
                    Quality::RtkFixed => Some(3),
                    Quality::RtkFloat => Some(4),
                    _ => None,
                };
                assert_eq!(report["status"].as_i64(), status, "{report}");
                if gga.quality == Quality::Invalid {
                    assert_eq!(report["mode"].as_i64(), Some(1), "{report}");
                }
                // Reports without a position repeat an older time.
                if gga.position_deg.is_some()
                    && sentences.len() == 1
                    && report.get("time").is_some()
                {
                    seconds(gga.time_of_day_s);
                }
            }
            Sentence::Rmc(rmc) => {
                assert!(rmc.is_valid && rmc.mode.is_some());
                check("lat", rmc.position_deg.map(|position| position[0]), 1e-9);
                check("lon", rmc.position_deg.map(|position| position[1]), 1e-9);
                check("speed", rmc.speed_mps, 6e-4);
                check("track", rmc.course_rad.map(f64::to_degrees), 1e-4);
                check("magvar", rmc.variation_rad.map(f64::to_degrees), 0.051);
                seconds(rmc.time_of_day_s);
                let (year, month, day) = rmc.date.unwrap();
                let date = format!("{year}-{month:02}-{day:02}");
                assert_eq!(
                    report["time"].as_str().map(|time| &time[..10]),
                    Some(&date[..])
                );
            }
            Sentence::Hdt(heading) => check("heading", heading.map(f64::to_degrees), 1e-4),
            Sentence::Dbt(depth) => check("depth", *depth, 1e-9),
            _ => {}
        }
    }
    compared
}

#[test]
fn values_of_the_captures_are_those_of_gpsd() {
    let Some(folder) = shared_data("nmea") else {
        return;
    };
    for (capture, messages, unknown, compared) in [
        ("hemi", 645, 108, 34),
        ("nmea-fuzzy-cases", 28, 0, 168),
        ("nmea-rtk", 244, 0, 1464),
        ("sounder", 122, 122, 121),
    ] {
        let log = fs::read(folder.join(format!("{capture}.log"))).unwrap();
        let (decoded, dropped) = decode(NmeaDecoder::default(), &log);
        assert_eq!(decoded.len(), messages, "{capture} {dropped:?}");
        assert_eq!(dropped.count(DropReason::UnknownKind), unknown, "{capture}");
        assert_eq!(dropped.count(DropReason::Field), 0, "{capture}");
        assert_eq!(dropped.count(DropReason::Checksum), 0, "{capture}");

        let text = fs::read_to_string(folder.join(format!("{capture}.log.chk"))).unwrap();
        let (mut sentences, mut count, mut again) = (vec![], 0, vec![]);
        for text in text.lines() {
            if text.starts_with('{') {
                count += compare(&serde_json::from_str(text).unwrap(), &sentences);
                sentences.clear();
            } else {
                let (messages, _) = decode(NmeaDecoder::default(), format!("{text}\n").as_bytes());
                sentences.extend(messages.iter().map(|message| message.sentence.clone()));
                again.extend(messages);
            }
        }
        assert_eq!(again, decoded, "{capture}");
        assert_eq!(count, compared, "{capture}");
    }
}

#[test]
fn sentences_of_all_kinds_are_decoded() {
    let deg = f64::to_radians;
    // Example lines of gpsd's "NMEA Revealed", and by hand.
    for (body, expected) in [
        ("GPHDT,274.07,T", Sentence::Hdt(Some(deg(274.07)))),
        ("GPHDT,,T", Sentence::Hdt(None)),
        (
            "GNTHS,121.15,A",
            Sentence::Ths(Ths {
                heading_rad: Some(deg(121.15)),
                mode: Some('A'),
            }),
        ),
        (
            "SDHDG,181.9,0.5,W,0.6,E",
            Sentence::Hdg(Hdg {
                compass_rad: Some(deg(181.9)),
                deviation_rad: Some(-deg(0.5)),
                variation_rad: Some(deg(0.6)),
            }),
        ),
        (
            "HCHDG,98.3,,,12.6,W",
            Sentence::Hdg(Hdg {
                compass_rad: Some(deg(98.3)),
                deviation_rad: None,
                variation_rad: Some(-deg(12.6)),
            }),
        ),
        (
            "GPGST,182141.000,15.5,15.3,7.2,21.8,0.9,0.5,0.8",
            Sentence::Gst(Gst {
                time_of_day_s: Some(66_101.0),
                ellipse_m: Some([15.3, 7.2]),
                ellipse_direction_rad: Some(deg(21.8)),
                sigma_m: [Some(0.9), Some(0.5), Some(0.8)],
            }),
        ),
        ("HEROT,60.0,A", Sentence::Rot(Some(-deg(1.0)))),
        ("HEROT,-60.0,V", Sentence::Rot(None)),
        (
            "INDPT,2.3,0.0",
            Sentence::Dpt(Dpt {
                depth_m: Some(2.3),
                offset_m: Some(0.0),
            }),
        ),
        (
            "SDDPT,15.2,-0.8,100",
            Sentence::Dpt(Dpt {
                depth_m: Some(15.2),
                offset_m: Some(-0.8),
            }),
        ),
        ("SDDBT,7.7,f,2.3,M,1.3,F", Sentence::Dbt(Some(2.3))),
        ("SDDBT,10,f,,M,,F", Sentence::Dbt(Some(10.0 * 0.3048))),
        ("SDDBT,,f,,M,2,F", Sentence::Dbt(Some(2.0 * 1.8288))),
        ("SDDBT,,f,,M,,F", Sentence::Dbt(None)),
        (
            "GPVTG,54.7,T,34.4,M,,N,36,K",
            Sentence::Vtg(Vtg {
                course_rad: Some(deg(54.7)),
                magnetic_course_rad: Some(deg(34.4)),
                speed_mps: Some(10.0),
                mode: None,
            }),
        ),
        (
            "GPVTG,,T,,M,,N,,K,N",
            Sentence::Vtg(Vtg {
                course_rad: None,
                magnetic_course_rad: None,
                speed_mps: None,
                mode: Some('N'),
            }),
        ),
    ] {
        assert_eq!(sentence(body), Ok(expected), "{body}");
    }
    let Ok(Sentence::Hdg(hdg)) = sentence("SDHDG,359.9,0.5,W,0.7,E") else {
        panic!()
    };
    close(hdg.true_heading_rad(), deg(0.1), 1e-12);
    let (messages, _) = decode(NmeaDecoder::default(), line("HEHDT,1.0,T").as_bytes());
    assert_eq!(&messages[0].talker, b"HE");
}

#[test]
fn the_example_of_the_manuals_gives_position_and_date() {
    // With the checksums that the manuals print.
    let (messages, dropped) = decode(
        NmeaDecoder::default(),
        b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n\
          $GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n",
    );
    assert_eq!(dropped, Dropped::default());
    let [
        Message {
            talker: [b'G', b'P'],
            sentence: Sentence::Gga(gga),
        },
        Message {
            sentence: Sentence::Rmc(rmc),
            ..
        },
    ] = &messages[..]
    else {
        panic!("{messages:?}")
    };
    let fix = gga.fix().unwrap();
    close(Some(fix.latitude_deg), 48.0 + 7.038 / 60.0, 1e-12);
    close(Some(fix.longitude_deg), 11.0 + 31.0 / 60.0, 1e-12);
    close(Some(fix.altitude_m), 592.3, 1e-9);
    assert_eq!(
        (fix.status, gga.satellites, gga.time_of_day_s),
        (0, Some(8), Some(45_319.0))
    );
    assert_eq!((rmc.date, rmc.is_valid), (Some((1994, 3, 23)), true));
    close(rmc.speed_mps, 11.523_555, 1e-5);
    close(rmc.variation_rad, -3.1_f64.to_radians(), 1e-12);
}

#[test]
fn qualities_give_the_status_of_a_fix() {
    for (quality, expected, status) in [
        ("0", Quality::Invalid, -1),
        ("", Quality::Invalid, -1),
        ("1", Quality::Autonomous, 0),
        ("2", Quality::Differential, 1),
        ("9", Quality::Differential, 1),
        ("3", Quality::Precise, 0),
        ("4", Quality::RtkFixed, 2),
        ("5", Quality::RtkFloat, 2),
        ("6", Quality::Estimated, -1),
        ("7", Quality::Manual, -1),
        ("8", Quality::Simulated, -1),
    ] {
        let body = format!("GNGGA,000000,0100.0,S,00200.0,W,{quality},9,1.0,5.0,M,,M,,");
        let Ok(Sentence::Gga(gga)) = sentence(&body) else {
            panic!("{body}")
        };
        let fix = gga.fix().unwrap();
        assert_eq!((gga.quality, fix.status), (expected, status));
        assert_eq!(
            (fix.latitude_deg, fix.longitude_deg, fix.altitude_m),
            (-1.0, -2.0, 5.0)
        );
    }
    let Ok(Sentence::Gga(flat)) = sentence("GNGGA,000000,0100.0,N,00200.0,E,1,4,2,,M,,M,,") else {
        panic!()
    };
    assert!(flat.fix().unwrap().altitude_m.is_nan());
}

#[test]
fn a_year_of_two_digits_is_of_1980_to_2079() {
    for (date, expected) in [
        ("060180", (1980, 1, 6)),
        ("311299", (1999, 12, 31)),
        ("010100", (2000, 1, 1)),
        ("311279", (2079, 12, 31)),
    ] {
        let Ok(Sentence::Rmc(rmc)) = sentence(&format!("GPRMC,,V,,,,,,,{date},,,N")) else {
            panic!("{date}")
        };
        assert_eq!(rmc.date, Some(expected));
    }
}

#[test]
fn bad_fields_drop_the_sentence() {
    for body in [
        "GPGGA,250000,4807.0,N,01131.0,E,1",
        "GPGGA,126000,4807.0,N,01131.0,E,1",
        "GPGGA,123561,4807.0,N,01131.0,E,1",
        "GPGGA,123519,4860.0,N,01131.0,E,1",
        "GPGGA,123519,9000.1,N,01131.0,E,1",
        "GPGGA,123519,4807.0,N,18000.1,E,1",
        "GPGGA,123519,4807.0,E,01131.0,E,1",
        "GPGGA,123519,4807.0,,01131.0,E,1",
        "GPGGA,123519,-4807.0,N,01131.0,E,1",
        "GPGGA,123519,4807.0,N,01131.0,E,10",
        "GPGGA,123519,4807.0,N,01131.0,E,x",
        "GPGGA,123519,4807.0,N,01131.0,E,1,8,inf",
        "GPGGA,123519,4807.0,N,01131.0,E,1,8,NaN",
        "GPGGA,123519,4807.0,N,01131.0,E,1,8,1e3",
        "GPGGA,123519,4807.0,N,01131.0,E,1,8,1.2.3",
        "GPGGA,123519,4807.0,N,01131.0,E,1,8,.",
        "GPRMC,123519,A,4807.0,N,01131.0,E,1,2,320394,,",
        "GPRMC,123519,A,4807.0,N,01131.0,E,1,2,011394,,",
        "GPRMC,123519,A,4807.0,N,01131.0,E,1,2,10194,,",
        "GPRMC,123519,A,4807.0,N,01131.0,E,-1,2,010194,,",
        "GPHDT,360.1,T",
        "GPHDT,-1,T",
        "GPVTG,1,2,3,4",
        "SDDPT,-1,0",
        "HCHDG,98.3,,,12.6,N",
        "GNTHS,1,AA",
    ] {
        assert_eq!(sentence(body), Err(DropReason::Field), "{body}");
    }
}

#[test]
fn bad_input_is_counted_and_the_next_sentence_is_found() {
    let good = line("GPHDT,274.07,T");
    let long = format!("${}", "A".repeat(255));
    let cases: [Case<'_>; 11] = [
        ("garbage", "\u{7f}abc", &[(DropReason::Garbage, 4)]),
        ("empty lines", "\r\n\n\r\n", &[]),
        (
            "wrong checksum",
            "$GPHDT,274.07,T*04\r\n",
            &[(DropReason::Checksum, 1)],
        ),
        (
            "no checksum",
            "$GPHDT,274.07,T\r\n",
            &[(DropReason::Checksum, 1)],
        ),
        (
            "no digits",
            "$GPHDT,274.07,T*zz\r\n",
            &[(DropReason::Checksum, 1)],
        ),
        (
            "signed digits",
            "$GPHDT,274.07,T*+3\r\n",
            &[(DropReason::Checksum, 1)],
        ),
        ("cut off", "$GPGGA,1235", &[(DropReason::CutOff, 1)]),
        (
            "cut off by another byte",
            "$GPGGA,\u{1}",
            &[(DropReason::Garbage, 1), (DropReason::CutOff, 1)],
        ),
        ("nothing", "$", &[(DropReason::CutOff, 1)]),
        (
            "too long",
            &long,
            &[(DropReason::Garbage, 255), (DropReason::Length, 1)],
        ),
        (
            "unknown",
            "$PASHR,1*45\r\n",
            &[(DropReason::UnknownKind, 1)],
        ),
    ];
    for (name, before, drops) in cases {
        let (messages, dropped) =
            decode(NmeaDecoder::default(), format!("{before}{good}").as_bytes());
        assert_eq!(messages.len(), 1, "{name}");
        assert_eq!(dropped.iter().collect::<Vec<_>>(), drops, "{name}");
    }
    // Small letters in the checksum, and a line end of one character.
    assert_eq!(
        decode(NmeaDecoder::default(), b"$SDDBT,7.9,f,2.4,M,1.3,F*0c\n")
            .0
            .len(),
        1
    );
    let longest = "A".repeat(MAX_LENGTH - 6);
    let (_, dropped) = decode(NmeaDecoder::default(), line(&longest).as_bytes());
    assert_eq!(dropped.count(DropReason::UnknownKind), 1);
}

/// Name, what comes before a good sentence, drops.
type Case<'a> = (&'a str, &'a str, &'a [(DropReason, u64)]);

fn any_line() -> impl Strategy<Value = Vec<u8>> {
    let kinds = prop::sample::select(vec![
        "GGA", "RMC", "VTG", "HDT", "THS", "HDG", "GST", "ROT", "DPT", "DBT", "XXX",
    ]);
    let field = prop_oneof![
        Just(String::new()),
        "[0-9]{1,6}(\\.[0-9]{0,4})?",
        "[-+ENSWATMK.]{1,2}",
        Just("4807.038".to_owned()),
        Just("N".to_owned()),
    ];
    let any_line = (kinds, prop::collection::vec(field, 0..16))
        .prop_map(|(kind, fields)| line(&format!("GN{kind},{}", fields.join(","))).into_bytes());
    let good = Just(line("GNGGA,133900.00,4134.50180323,N,09345.03586581,W,4,19,0.7,280.827,M,-31.442,M,6.0,0002").into_bytes());
    prop_oneof![any_line, good]
}

proptest! {
    #[test]
    fn damage_neither_panics_nor_gives_senseless_values(
        lines in prop::collection::vec(any_line(), 0..12),
        damage in damage(b"$*,\r\n"),
    ) {
        for message in damage.decode(NmeaDecoder::default, lines.concat()) {
            match message.sentence {
                Sentence::Gga(gga) => if let Some(fix) = gga.fix() {
                    prop_assert!(fix.latitude_deg.abs() <= 90.0 && fix.longitude_deg.abs() <= 180.0);
                    prop_assert!(gga.time_of_day_s.is_none_or(|time| (0.0..86_461.0).contains(&time)));
                },
                Sentence::Hdt(heading) => prop_assert!(heading.is_none_or(|heading| (0.0..=TAU).contains(&heading))),
                Sentence::Dbt(depth) => prop_assert!(depth.is_none_or(|depth| depth >= 0.0 && depth.is_finite())),
                Sentence::Rot(rate) => prop_assert!(rate.is_none_or(f64::is_finite)),
                _ => {}
            }
        }
    }

}
