//! Memory for what grows with the number of worlds, and with the model: a request that the system cannot grant, or that is
//! beyond the limit, is an error, not the end of the process.

use std::fs;

use crate::error::{Error, gigabytes};

/// Bytes that need no permission.
const FREE: usize = 1 << 26;

/// The product of `factors`, if it can be counted.
pub(crate) fn product(factors: &[usize]) -> Option<usize> {
    factors.iter().try_fold(1_usize, |product, factor| product.checked_mul(*factor))
}

/// That product in words.
pub(crate) fn count(factors: &[usize]) -> String {
    product(factors).map_or_else(|| "more than can be counted".to_owned(), |n| n.to_string())
}

/// An error if the system does not grant as many bytes as `factors` multiply to. `what` they are for goes into the message.
pub(crate) fn ask(what: &'static str, factors: &[usize]) -> Result<(), Error> {
    let refused = |bytes| Error::Memory { what, bytes };
    let bytes = product(factors).ok_or_else(|| refused(None))?;
    Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| refused(Some(bytes)))
}

/// As many zeros as `factors` multiply to, within `limit` bytes (see [`check`]). They are asked for first and then taken as the
/// system's own zeroed pages, which cost nothing until they are used.
pub(crate) fn zeros(what: &'static str, factors: &[usize], limit: Option<usize>) -> Result<Vec<f64>, Error> {
    let n = product(factors).ok_or(Error::Memory { what, bytes: None })?;
    ask(what, &[n, size_of::<f64>()])?;
    check(n * size_of::<f64>(), limit, || what.to_owned(), "worlds, steps or outputs")?;
    Ok(vec![0.0; n])
}

/// An error if blocks of worlds, and scratch of threads, each so many of so many bytes, are beyond `limit`.
pub(crate) fn check_batch(
    (blocks, block): (usize, usize),
    (threads, scratch): (usize, usize),
    limit: Option<usize>,
) -> Result<(), Error> {
    // What no system gives need not be held against a limit.
    ask("the worlds", &[blocks, block])?;
    let worlds = blocks.saturating_mul(block);
    let all = threads.checked_mul(scratch).and_then(|bytes| bytes.checked_add(worlds));
    let what = || {
        let scratch = gigabytes(scratch);
        format!("the worlds ({}) and the scratch of {threads} threads ({scratch} each)", gigabytes(worlds))
    };
    check(all.unwrap_or(usize::MAX), limit, what, "worlds or threads, or make the model smaller")
}

/// An error if `bytes` are beyond `limit`; `None`: three quarters of what the system has to give.
fn check(bytes: usize, limit: Option<usize>, what: impl Fn() -> String, fewer: &'static str) -> Result<(), Error> {
    if limit.is_none() && bytes <= FREE {
        return Ok(());
    }
    let limit = limit.unwrap_or_else(|| available().map_or(isize::MAX as usize, |bytes| bytes / 4 * 3));
    if bytes <= limit {
        return Ok(());
    }
    Err(Error::MemoryLimit { what: what(), bytes, limit, fewer })
}

/// Bytes of memory that can be had without swapping, as Linux estimates them, and within what the process' group may have;
/// `None` elsewhere.
pub fn available() -> Option<usize> {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let number = |path: &str| read(path).trim().parse::<usize>().ok();
    let group = number("/sys/fs/cgroup/memory.max").zip(number("/sys/fs/cgroup/memory.current"));
    let left = group.map(|(most, used)| most.saturating_sub(used));
    let machine = parse(&read("/proc/meminfo"));
    machine.into_iter().chain(left).min()
}

fn parse(meminfo: &str) -> Option<usize> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kilobytes: usize = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kilobytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_is_an_error() {
        assert_eq!(zeros("numbers", &[2, 3], None).unwrap(), [0.0; 6]);
        assert!(zeros("none", &[0, usize::MAX], None).unwrap().is_empty());
        for factors in [&[usize::MAX, 2][..], &[usize::MAX / 2], &[1 << 40, 1 << 10]] {
            let message = zeros("the numbers", factors, None).unwrap_err().to_string();
            assert!(message.contains("the numbers"), "{message}");
        }
    }

    #[test]
    fn what_is_beyond_the_limit_is_an_error_with_the_figures() {
        assert!(zeros("the outputs", &[1000], Some(8000)).is_ok());
        let message = zeros("the outputs", &[1001], Some(8000)).unwrap_err().to_string();
        assert!(message.contains("the outputs would take 8.0 kB"), "{message}");
        let message = check_batch((3, 1_000_000), (2, 4_200_000_000), Some(1 << 30)).unwrap_err().to_string();
        for figure in ["3.0 MB", "2 threads (4.2 GB each)", "8.4 GB", "1.1 GB", "max_memory"] {
            assert!(message.contains(figure), "{message}");
        }
        assert!(check_batch((usize::MAX, 2), (1, 1), None).is_err());
        assert!(check_batch((1, 1), (usize::MAX, 2), None).is_err());
    }

    #[test]
    fn meminfo() {
        assert_eq!(parse("MemTotal: 9 kB\nMemAvailable:   123 kB\n"), Some(123 * 1024));
        assert_eq!(parse("MemTotal: 9 kB\n"), None);
    }
}
