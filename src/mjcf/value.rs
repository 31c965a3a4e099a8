//! The values of attributes: numbers, lists, keywords. Errors are the message alone; the caller knows the place.

use crate::diagnostics::shorten;
use crate::spec::Tri;
use crate::suggest::did_you_mean;

/// Reads a list of finite numbers separated by white space.
pub(super) fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split_ascii_whitespace().map(number).collect()
}

/// Reads the two ends of a range; what is infinite bounds nothing. Says whether they were given.
pub(super) fn bounds(text: &str, target: &mut [f64; 2]) -> Result<bool, String> {
    let infinite = |word: &str| match word.trim_start_matches(['+', '-']).to_ascii_lowercase().as_str() {
        "inf" | "infinity" => word.parse::<f64>().ok(),
        _ => None,
    };
    fill(text, target, |word| infinite(word).map_or_else(|| number(word), Ok))
}

/// Reads one finite number.
fn number(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        Ok(_) if word.contains(|c: char| c.is_ascii_digit()) => Err(format!("\"{}\" is too large", shorten(word))),
        Ok(_) => Err(format!("\"{}\" is not a finite number", shorten(word))),
        Err(_) => {
            let remedy = if word.contains([',', ';']) { "; separate numbers by blanks" } else { "" };
            Err(format!("\"{}\" is not a number{remedy}", shorten(word)))
        }
    }
}

/// Reads exactly as many numbers as `target` holds. An empty list leaves it alone; the result says whether one was given.
pub(super) fn exactly(text: &str, target: &mut [f64]) -> Result<bool, String> {
    fill(text, target, number)
}

fn fill(text: &str, target: &mut [f64], read: impl Fn(&str) -> Result<f64, String>) -> Result<bool, String> {
    let words = text.split_ascii_whitespace();
    // Read what there is room for, and only count the rest.
    let list: Vec<f64> = words.clone().take(target.len()).map(read).collect::<Result<_, _>>()?;
    if list.is_empty() {
        return Ok(false);
    }
    let found = words.count();
    if found != target.len() {
        return Err(format!("expected {}, found {found}", plural(target.len())));
    }
    target.copy_from_slice(&list);
    Ok(true)
}

/// Reads at most as many numbers as `target` holds and replaces its first ones; says whether any was given.
pub(super) fn leading(text: &str, target: &mut [f64]) -> Result<bool, String> {
    let words = text.split_ascii_whitespace();
    let list: Vec<f64> = words.clone().take(target.len()).map(number).collect::<Result<_, _>>()?;
    let found = words.count();
    if found > target.len() {
        return Err(format!("expected at most {}, found {found}", plural(target.len())));
    }
    target[..list.len()].copy_from_slice(&list);
    Ok(!list.is_empty())
}

fn plural(n: usize) -> String {
    if n == 1 { "1 number".into() } else { format!("{n} numbers") }
}

/// Reads 32-bit integers separated by white space.
pub(super) fn integers(text: &str) -> Result<Vec<i32>, String> {
    text.split_ascii_whitespace()
        .map(|word| {
            word.parse::<i32>().map_err(|_| match word.parse::<i128>() {
                Ok(_) => format!("\"{}\" is too large", shorten(word)),
                Err(_) => format!("\"{}\" is not an integer", shorten(word)),
            })
        })
        .collect()
}

/// Reads one integer; `None` if the text is blank.
pub(super) fn integer(text: &str) -> Result<Option<i32>, String> {
    let list = integers(text)?;
    if list.len() > 1 {
        return Err(format!("expected 1 integer, found {}", list.len()));
    }
    Ok(list.first().copied())
}

/// Finds a keyword, exactly as it must be spelled.
pub(super) fn keyword<T: Copy>(text: &str, table: &[(&str, T)]) -> Result<T, String> {
    table.iter().find(|(word, _)| *word == text).map(|&(_, value)| value).ok_or_else(|| {
        let words: Vec<&str> = table.iter().map(|&(word, _)| word).collect();
        let near = match did_you_mean(text, words.iter().copied()) {
            near if near.is_empty() => near,
            near => format!("; {near}"),
        };
        format!("\"{}\" is not one of {}{near}", shorten(text), words.join(", "))
    })
}

/// `true` and `false`.
pub(super) const BOOLEAN: &[(&str, bool)] = &[("true", true), ("false", false)];
/// `true`, `false` and `auto`.
pub(super) const TRI: &[(&str, Tri)] = &[("true", Tri::True), ("false", Tri::False), ("auto", Tri::Auto)];
