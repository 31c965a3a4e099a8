//! A request that cannot fit is refused in words; allocating it would end the process without any.

use lanesim::memory::available;

use super::failure::Failure;

/// An error if `what` needs more bytes, the product of `factors`, than `limit`; `None`: than the machine has to give.
pub fn check(what: &str, factors: &[usize], limit: Option<usize>) -> Result<(), Failure> {
    let bytes = factors.iter().try_fold(1u64, |product, &f| product.checked_mul(f as u64));
    // Elsewhere than on Linux as many as can be addressed.
    let most = limit.or_else(available).unwrap_or(isize::MAX as usize) as u64;
    match bytes {
        Some(bytes) if bytes <= most => Ok(()),
        _ => {
            let need = bytes.map_or("too much".to_owned(), |b| format!("{:.1} GB of", b as f64 / 1e9));
            let (have, why) = (most as f64 / 1e9, if limit.is_some() { "allowed (--max-memory)" } else { "available" });
            Err(Failure::Input(format!(
                "{what} would take {need} memory, {have:.1} GB are {why}; ask for fewer worlds, steps or outputs"
            )))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_weighed() {
        assert!(check("a page", &[4096], None).is_ok());
        assert!(check("a page", &[4096], Some(4095)).is_err());
        assert!(check("nothing", &[1 << 40, 0, 1 << 40], None).is_ok());
        for factors in [&[1 << 31, 1 << 30][..], &[1 << 31, 1 << 31, 1 << 31]] {
            assert!(check("too much", factors, None).is_err());
        }
    }
}
