//! Pictures of known curves. Run by the threads of the test harness.

use super::scene::{HEIGHT, SQUARE, Scene, Shape, TITLE, WIDTH};
use super::*;

fn picture() -> Plot {
    let wave = (0..1000).map(|i| (f64::from(i) * 1e-3, (f64::from(i) * 0.01).sin()));
    let curve = PlotCurve {
        name: "a<b>&\"c\"".to_owned(),
        segments: vec![wave.collect()],
        colour: 0,
    };
    let panel = PlotPanel {
        is_spatial: true,
        across: "x [m]".to_owned(),
        frame: Some([-1.0, 2.0, -2.0, f64::INFINITY]),
        ..PlotPanel::over_time("y [m]".to_owned(), vec![curve.clone()])
    };
    let empty = PlotPanel::over_time("nothing".to_owned(), vec![PlotCurve::default()]);
    let time = PlotPanel {
        limits: vec![1.0, -1.0],
        marks: vec![0.5],
        ..PlotPanel::over_time("wave [1]".to_owned(), vec![curve])
    };
    Plot {
        title: "a net".to_owned(),
        panels: vec![panel.clone(), panel, time, empty],
    }
}

#[test]
fn a_plot_is_reproducible_and_escapes_names() {
    for text in [picture().svg(), picture().html()] {
        assert!(text.contains("a&lt;b&gt;&amp;") && !text.contains("a<b>"));
        assert!(text.contains("time [s]") && text.contains("wave [1]"));
        assert!(text.contains("prefers-color-scheme:dark"));
        assert!(text.len() < 60_000, "{} bytes", text.len());
    }
    let svg = picture().svg();
    assert_eq!(svg, picture().svg());
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
}

#[test]
fn a_page_loads_nothing() {
    let html = picture().html();
    assert!(html.starts_with("<!doctype html>") && html.contains("<script>"));
    let addresses = html.matches("http").count();
    // The namespace URIs of SVG are identifiers; nothing is loaded from them.
    assert_eq!(
        addresses,
        html.matches("http://www.w3.org/2000/svg").count()
    );
    assert!(!html.contains(" src=") && !html.contains("@import") && !html.contains("<link"));
    assert!(
        html.contains("data-range=\"0 0.999 "),
        "the script knows the axes"
    );
}

#[test]
fn twelve_thousand_points_of_a_sine_stay_a_sine() {
    let wave = |i: u32| (0.03 * f64::from(i) * std::f64::consts::TAU / 360.0).sin();
    let points = (0..12_000)
        .map(|i| (f64::from(i) * 1e-3, wave(i)))
        .collect();
    let curve = PlotCurve {
        name: "sine".to_owned(),
        segments: vec![points],
        colour: 0,
    };
    let plot = Plot {
        title: String::new(),
        panels: vec![PlotPanel::over_time("sine".to_owned(), vec![curve])],
    };
    let scene = Scene::of(&plot);
    let panel = &scene.panels[0];
    let segments = panel.inside.iter().find_map(|shape| match shape {
        Shape::Line { segments, name, .. } if name == "sine" => Some(&segments[0]),
        _ => None,
    });
    let segment = segments.expect("the curve");
    assert!((20..1000).contains(&segment.len()), "{}", segment.len());
    // Between two drawn points the line is at most a tenth of a pixel from the sine, everywhere.
    let ([left, right, bottom, top], [_, _, width, height]) = (panel.range, panel.area);
    for pair in segment.windows(2) {
        for step in 0..=10 {
            let part = f64::from(step) / 10.0;
            let [x, y] = [0, 1].map(|axis| pair[0][axis] + part * (pair[1][axis] - pair[0][axis]));
            let time = left + x / width * (right - left);
            let expected = wave(0) + (0.03 * time * 1e3 * std::f64::consts::TAU / 360.0).sin();
            let drawn = top - y / height * (top - bottom);
            let pixels = (drawn - expected).abs() / (top - bottom) * height;
            assert!(pixels < 0.1, "{pixels} at {time} s");
        }
    }
    // No flat tops: no two neighbouring points of the file have the same height.
    let flat = segment
        .windows(2)
        .filter(|pair| (pair[0][1] - pair[1][1]).abs() < 0.005);
    assert!(flat.count() <= 1);
}

#[test]
fn a_png_has_letters_and_lines() {
    let mut bytes = Vec::new();
    picture().png(&mut bytes).unwrap();
    let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let height = (TITLE + SQUARE + 2.0 * HEIGHT) as u32;
    assert_eq!((info.width, info.height), (WIDTH as u32, height));
    let rows = || pixels.chunks(WIDTH as usize * 3);
    let dark = |from: usize, count: usize| {
        let values = rows().skip(from).take(count).flatten();
        values.filter(|value| **value < 100).count()
    };
    assert!(dark(0, TITLE as usize) > 100, "the title is written");
    // The blue curve of the panel over time.
    let blue = rows().skip((TITLE + SQUARE) as usize).take(HEIGHT as usize);
    let blue = blue
        .flat_map(|row| row.chunks(3))
        .filter(|pixel| *pixel == [0, 114, 178]);
    assert!(blue.count() > 300, "the curve is drawn");
}
