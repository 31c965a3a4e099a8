//! The picture: cost against iteration, and against time.

use std::path::Path;

use lanesim::optimise::Row;
use plotters::prelude::*;

const COLOURS: [RGBColor; 2] = [RGBColor(30, 90, 170), RGBColor(200, 80, 40)];

/// Iterations of one engine.
pub struct Line<'a> {
    pub name: String,
    pub rows: &'a [Row],
}

/// Why a picture could not be drawn.
type Result = std::result::Result<(), Box<dyn std::error::Error>>;

/// Both, side by side.
pub fn costs(file: &Path, title: &str, lines: &[Line<'_>]) -> Result {
    let area = SVGBackend::new(file, (1000, 420)).into_drawing_area();
    area.fill(&WHITE)?;
    let area = area.titled(title, ("sans-serif", 20))?;
    let halves = area.split_evenly((1, 2));
    chart(&halves[0], "iteration", lines, |row| row.iteration as f64)?;
    chart(&halves[1], "seconds", lines, |row| row.seconds)?;
    Ok(area.present()?)
}

fn chart(
    area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    what: &str,
    lines: &[Line<'_>],
    x: fn(&Row) -> f64,
) -> Result {
    let all = || lines.iter().flat_map(|line| line.rows).filter(|row| row.cost > 0.0);
    let most = all().map(x).fold(0.0, f64::max).max(1e-6);
    let low = all().map(|row| row.cost).fold(f64::INFINITY, f64::min);
    let high = all().map(|row| row.cost).fold(0.0, f64::max);
    if high <= 0.0 {
        return Ok(());
    }
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(64)
        .build_cartesian_2d(0.0..most, (0.8 * low..1.25 * high).log_scale())?;
    chart.configure_mesh().x_desc(what).y_desc("cost").light_line_style(RGBColor(238, 238, 238)).draw()?;
    for (line, colour) in lines.iter().zip(COLOURS) {
        let points = line.rows.iter().filter(|row| row.cost > 0.0).map(|row| (x(row), row.cost));
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)))?
            .label(line.name.as_str())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart.configure_series_labels().background_style(WHITE.mix(0.8)).border_style(RGBColor(200, 200, 200)).draw()?;
    Ok(())
}
