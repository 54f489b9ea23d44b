use super::*;

fn train(heading_rad: f64) -> WaveTrain {
    WaveTrain {
        height_m: 0.4,
        period_s: 3.0,
        heading_rad,
    }
}

/// Mean of `value` over a quarter of an hour.
fn mean(value: impl Fn(f64) -> f64) -> f64 {
    let n = 9000;
    (0..n).map(|i| value(f64::from(i) * 0.1)).sum::<f64>() / f64::from(n)
}

#[test]
fn the_surface_has_the_significant_height_of_its_trains() {
    let at_m = Point2::new(3.0, -2.0);
    let significant_m = |trains: &[WaveTrain]| {
        let waves = Waves::new(trains);
        let variance_m2 = mean(|time_s| waves.height_m(at_m, time_s).powi(2));
        assert!(mean(|time_s| waves.height_m(at_m, time_s)).abs() < 1e-3);
        4.0 * libm::sqrt(variance_m2)
    };
    assert!((significant_m(&[train(0.3)]) - 0.4).abs() < 0.002);
    // Variances add up.
    let swell = WaveTrain {
        height_m: 0.3,
        period_s: 5.3,
        heading_rad: 2.0,
    };
    let both_m = significant_m(&[train(0.3), swell]);
    assert!((both_m - 0.5).abs() < 0.005, "{both_m}");
    assert!(significant_m(&[]) < 1e-12);
}

#[test]
fn waves_run_where_they_head_at_the_speed_of_deep_water() {
    // 14.05 m in 3 s.
    assert!((train(0.0).length_m() - 14.05).abs() < 0.01);
    assert!((train(0.0).greatest_height_m() - 2.007).abs() < 0.001);
    for heading_rad in [0.0, 1.0, -2.0] {
        let waves = Waves::new(&[train(heading_rad)]);
        let ahead = Vector2::new(libm::cos(heading_rad), libm::sin(heading_rad));
        // Who moves along with the strongest wave keeps its place on it, and on average nothing of the others:
        // at two places a quarter of its length apart, cosine and sine of the same phase.
        let kept_m2 = |speed_mps: f64| {
            let moved_m = |time_s: f64, off_m: f64| {
                let at_m = Point2::from(ahead * (speed_mps * time_s + off_m));
                waves.height_m(at_m, time_s)
            };
            let quarter_m = 0.25 * train(0.0).length_m();
            [0.0, quarter_m].map(|off_m| mean(|time_s| moved_m(time_s, off_m)).powi(2))
        };
        let speed_mps = train(0.0).length_m() / 3.0;
        // 0.4 of the energy: a²/2 = 0.4 · (0.1 m)².
        let amplitude2_m2: f64 = kept_m2(speed_mps).iter().sum();
        assert!((amplitude2_m2 - 0.008).abs() < 2e-4, "{amplitude2_m2}");
        assert!(kept_m2(-speed_mps).iter().sum::<f64>() < 2e-4);
    }
}

const BOAT: Hull = Hull {
    length_m: 4.5,
    width_m: 2.44,
};

fn heading(yaw_rad: f64) -> PlanarPose {
    PlanarPose {
        position_m: Point2::new(10.0, 20.0),
        yaw_rad,
    }
}

/// Waves along x that pass a boat at rest.
fn along_x(height_m: f64, period_s: f64) -> Waves {
    Waves::new(&[WaveTrain {
        height_m,
        period_s,
        heading_rad: 0.0,
    }])
}

/// Standard deviations of height, pitch and roll over 20 minutes, after which waves of 12 s repeat.
fn spread(waves: &Waves, yaw_rad: f64) -> [f64; 3] {
    let n = 12_000;
    let mut sums = [0.0; 3];
    for step in 0..n {
        let posture = BOAT.afloat(heading(yaw_rad), waves, 0.0, f64::from(step) * 0.1);
        for (sum, value) in sums
            .iter_mut()
            .zip([posture.z_m, posture.pitch_rad, posture.roll_rad])
        {
            *sum += value * value;
        }
    }
    sums.map(|sum| libm::sqrt(sum / f64::from(n)))
}

#[test]
fn still_water_holds_the_boat_level_at_its_height() {
    let posture = BOAT.afloat(heading(1.0), &Waves::default(), 3.5, 7.0);
    let expected = Posture {
        z_m: 3.5,
        ..Posture::default()
    };
    assert_eq!(posture, expected);
}

#[test]
fn a_long_swell_lifts_the_boat_and_tilts_it_by_its_slope() {
    // Waves of 225 m are a slope under the boat: k = ω²/g = 0.027956 at the strongest; 4 σ = 2 m.
    let waves = along_x(2.0, 12.0);
    // Short waves are steeper: the root of Σ energy · frequency⁴ · cos²(heading).
    let slope_rad = 0.5 * 0.027_956 * 1.0287;
    let head_seas = spread(&waves, 0.0);
    let beam_seas = spread(&waves, 0.5 * std::f64::consts::PI);
    assert!((head_seas[0] - 0.5).abs() < 0.001, "{head_seas:?}");
    assert!(
        (head_seas[1] / slope_rad - 1.0).abs() < 0.003,
        "{head_seas:?}"
    );
    assert!(
        (beam_seas[2] / slope_rad - 1.0).abs() < 0.003,
        "{beam_seas:?}"
    );
    // The spread of headings rolls it in head seas a little.
    assert!(head_seas[2] < 0.2 * head_seas[1], "{head_seas:?}");
}

#[test]
fn the_bow_rises_on_the_front_of_a_wave() {
    let waves = along_x(2.0, 12.0);
    for step in 0..100 {
        let time_s = f64::from(step);
        let height_m = |x_m, y_m| waves.height_m(Point2::new(10.0 + x_m, 20.0 + y_m), time_s);
        let ahead = BOAT.afloat(heading(0.0), &waves, 0.0, time_s);
        let rises_m = height_m(2.25, 0.0) - height_m(-2.25, 0.0);
        assert!((ahead.pitch_rad + libm::atan(rises_m / 4.5)).abs() < 1e-12);
        // Port is to −x for a boat that heads to the right of its waves, +y to the left of ahead.
        let abeam = BOAT.afloat(heading(0.5 * std::f64::consts::PI), &waves, 0.0, time_s);
        let port_rises_m = height_m(-1.22, 0.0) - height_m(1.22, 0.0);
        assert!((abeam.roll_rad - libm::atan(port_rises_m / 2.44)).abs() < 1e-12);
    }
}

#[test]
fn waves_shorter_than_the_hull_hardly_move_it() {
    // As long as the hull: bow and stern are on crests together while the sides are in the trough.
    let period_s = libm::sqrt(4.5 * std::f64::consts::TAU / 9.80665);
    let head_seas = spread(&along_x(0.4, period_s), 0.0);
    assert!(head_seas[0] < 0.35 * 0.1, "{head_seas:?}");
    let slope_rad = 0.1 * std::f64::consts::TAU / 4.5;
    assert!(head_seas[1] < 0.35 * slope_rad, "{head_seas:?}");
}
