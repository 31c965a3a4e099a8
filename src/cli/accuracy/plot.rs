//! Pictures: work against error of a scenario, and all ratios at a glance.

use std::path::Path;

use plotters::prelude::*;

use super::campaign::Row;
use super::curve::{FLOOR, Point, hull, median};
use super::report::{Line, points};

const ENGINES: [(&str, RGBColor); 3] = [
    ("MuJoCo", RGBColor(200, 80, 40)),
    ("lanesim f64", RGBColor(30, 90, 170)),
    ("lanesim f32", RGBColor(60, 160, 120)),
];

/// Why a picture could not be drawn.
type Result = std::result::Result<(), Box<dyn std::error::Error>>;

fn span(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let fold = |(least, most): (f64, f64), x: f64| (least.min(x), most.max(x));
    let (least, most) = values.fold((f64::INFINITY, 0.0), fold);
    (least.is_finite() && most > 0.0).then_some((0.5 * least, 2.0 * most))
}

/// Work against error, every setting a point, and each engine's hull a line. Nothing is drawn if nothing was measured.
pub fn scenario(file: &Path, title: &str, rows: &[Row]) -> Result {
    let all: Vec<Vec<Point>> = ENGINES.map(|(engine, _)| points(rows, engine)).into();
    let flat = || all.iter().flatten();
    let floor = |p: &Point| p.error.max(FLOOR);
    let (Some(errors), Some(works)) = (span(flat().map(floor)), span(flat().map(|p| p.work))) else { return Ok(()) };
    let area = SVGBackend::new(file, (760, 520)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(70)
        .build_cartesian_2d((errors.0..errors.1).log_scale(), (works.0..works.1).log_scale())?;
    let power = |x: &f64| format!("{x:.0e}");
    chart
        .configure_mesh()
        .x_desc("error")
        .y_desc("wall seconds per simulated second, world and core")
        .x_label_formatter(&power)
        .y_label_formatter(&power)
        .light_line_style(RGBColor(238, 238, 238))
        .draw()?;
    for ((name, colour), points) in ENGINES.iter().zip(&all) {
        let dots = points.iter().map(|p| Circle::new((floor(p), p.work), 3, colour.mix(0.45).filled()));
        chart.draw_series(dots)?;
        let line = hull(points).into_iter().map(|p| (p.error, p.work));
        let colour = *colour;
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(RGBColor(200, 200, 200))
        .draw()?;
    Ok(area.present()?)
}

/// The ratio of work at equal error of every scenario: a dot per error, the middle one large.
pub fn summary(file: &Path, lines: &[Line]) -> Result {
    let compared: Vec<&Line> = lines.iter().filter(|line| (0..2).any(|k| median(line.ratios(k)).is_some())).collect();
    let ratios = compared.iter().flat_map(|line| (0..2).flat_map(|k| line.ratios(k))).flatten();
    let Some((least, most)) = span(ratios) else { return Ok(()) };
    let n = compared.len();
    let area = SVGBackend::new(file, (860, 90 + 24 * n as u32)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption("MuJoCo's work over lanesim's at equal error", ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(290)
        .build_cartesian_2d((least.min(0.5)..most.max(200.0)).log_scale(), -0.5..n as f64 - 0.5)?;
    let label = |y: &f64| {
        let at = n as f64 - 1.0 - y.round();
        let line = (at >= 0.0 && (y - y.round()).abs() < 1e-6).then(|| compared.get(at as usize)).flatten();
        line.map_or(String::new(), |line| format!("{} {}", line.id, line.what))
    };
    chart
        .configure_mesh()
        .x_desc("times less work")
        .y_labels(n + 1)
        .y_max_light_lines(0)
        .x_label_formatter(&|x| format!("{x}"))
        .y_label_formatter(&label)
        .light_line_style(RGBColor(238, 238, 238))
        .draw()?;
    let bar = |x: f64, colour: RGBColor| PathElement::new([(x, -0.5), (x, n as f64 - 0.5)], colour.stroke_width(1));
    chart.draw_series([bar(1.0, BLACK), bar(10.0, RGBColor(150, 150, 150))])?;
    for (k, (name, colour)) in ENGINES[1..].iter().enumerate() {
        let place = |i: usize| n as f64 - 1.0 - i as f64 + if k == 0 { 0.12 } else { -0.12 };
        let dots = compared.iter().enumerate().flat_map(|(i, line)| {
            let middle = median(line.ratios(k));
            let all = line.ratios(k).into_iter().flatten().map(move |x| (x, 2));
            all.chain(middle.map(|x| (x, 5)))
                .map(move |(x, size)| Circle::new((x, place(i)), size, colour.mix(0.8).filled()))
        });
        let colour = *colour;
        chart.draw_series(dots)?.label(*name).legend(move |(x, y)| Circle::new((x + 9, y), 5, colour.filled()));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(RGBColor(200, 200, 200))
        .draw()?;
    Ok(area.present()?)
}
