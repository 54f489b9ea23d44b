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
