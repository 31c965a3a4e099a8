//! Files that hold height fields: PNG, of which the first channel counts, and MuJoCo's own format.

use std::io::Cursor;

/// Most points of a height field.
pub(crate) const MOST_POINTS: usize = 4_000_000;

/// Heights as a file or a model has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Raw {
    /// Points along y and along x.
    pub size: [usize; 2],
    /// Row by row from the least y.
    pub heights: Vec<f32>,
}

impl Raw {
    /// Heights that are written row by row from the largest y.
    pub fn from_above(size: [usize; 2], heights: &[f32]) -> Raw {
        Raw { size, heights: heights.chunks(size[1].max(1)).rev().flatten().copied().collect() }
    }

    /// Reads a file that a name's end or a content type says to be PNG, or MuJoCo's format; the error says what is wrong with it.
    pub fn read(bytes: &[u8], is_png: bool) -> Result<Raw, String> {
        let raw = if is_png { png(bytes) } else { binary(bytes) }?;
        raw.problem().map_or(Ok(raw), Err)
    }

    /// What is wrong with it.
    pub fn problem(&self) -> Option<String> {
        let [rows, columns] = self.size;
        if rows < 2 || columns < 2 {
            return Some(format!("{rows} by {columns} points are too few; a height field has at least 2 by 2"));
        }
        if rows.saturating_mul(columns) > MOST_POINTS {
            return Some(format!("more than {MOST_POINTS} points"));
        }
        self.heights.iter().position(|height| !height.is_finite()).map(|at| format!("height {at} is not finite"))
    }

    /// Heights from 0 to 1; all 0 if they are equal.
    pub fn normalised(&self) -> Vec<f64> {
        let low = self.heights.iter().copied().fold(f32::INFINITY, f32::min);
        let range = self.heights.iter().copied().fold(f32::NEG_INFINITY, f32::max) - low;
        let scaled = |height: &f32| if range > f32::EPSILON { (height - low) / range } else { 0.0 };
        self.heights.iter().map(|height| f64::from(scaled(height))).collect()
    }
}

fn png(bytes: &[u8]) -> Result<Raw, String> {
    let wrong = |error: png::DecodingError| format!("is not a PNG file: {error}");
    let limits = png::Limits { bytes: 16 * MOST_POINTS };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(wrong)?;
    let size = [reader.info().height as usize, reader.info().width as usize];
    if size[0].saturating_mul(size[1]) > MOST_POINTS {
        return Err(format!("has more than {MOST_POINTS} points"));
    }
    let mut pixels = vec![0; reader.output_buffer_size().ok_or("is too large")?];
    let frame = reader.next_frame(&mut pixels).map_err(wrong)?;
    let channels = frame.color_type.samples();
    let heights: Vec<f32> = pixels[..frame.buffer_size()].iter().step_by(channels).map(|x| f32::from(*x)).collect();
    Ok(Raw::from_above(size, &heights))
}

/// The numbers of rows and columns, then the heights, all little-endian and 32 bits wide.
fn binary(bytes: &[u8]) -> Result<Raw, String> {
    let mut words = bytes.chunks_exact(4).map(|word| [word[0], word[1], word[2], word[3]]);
    let mut count = || words.next().map(i32::from_le_bytes).and_then(|n| usize::try_from(n).ok());
    let (Some(rows), Some(columns)) = (count(), count()) else {
        return Err("is no height field: it ends within the header, or a count in it is negative".into());
    };
    let wanted = rows.saturating_mul(columns).saturating_mul(4).saturating_add(8);
    if wanted != bytes.len() {
        return Err(format!("is no height field: {wanted} bytes are announced, and there are {}", bytes.len()));
    }
    Ok(Raw { size: [rows, columns], heights: words.map(f32::from_le_bytes).collect() })
}
