//! Memory for what grows with the number of worlds: a request that the system cannot grant is an error, not the end of the
//! process.

use crate::error::Error;

/// The product of `factors`, if it can be counted.
pub(crate) fn product(factors: &[usize]) -> Option<usize> {
    factors.iter().try_fold(1_usize, |product, factor| product.checked_mul(*factor))
}

/// An error if the system does not grant as many bytes as `factors` multiply to. `what` they are for goes into the message.
pub(crate) fn ask(what: &'static str, factors: &[usize]) -> Result<(), Error> {
    let refused = |bytes| Error::Memory { what, bytes };
    let bytes = product(factors).ok_or_else(|| refused(None))?;
    Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| refused(Some(bytes)))
}

/// As many zeros as `factors` multiply to. They are asked for first and then taken as the system's own zeroed pages, which
/// cost nothing until they are used.
pub(crate) fn zeros(what: &'static str, factors: &[usize]) -> Result<Vec<f64>, Error> {
    let n = product(factors).ok_or(Error::Memory { what, bytes: None })?;
    ask(what, &[n, size_of::<f64>()])?;
    Ok(vec![0.0; n])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_is_an_error() {
        assert_eq!(zeros("numbers", &[2, 3]).unwrap(), [0.0; 6]);
        assert!(zeros("none", &[0, usize::MAX]).unwrap().is_empty());
        for factors in [&[usize::MAX, 2][..], &[usize::MAX / 2], &[1 << 40, 1 << 10]] {
            let message = zeros("the numbers", factors).unwrap_err().to_string();
            assert!(message.contains("the numbers"), "{message}");
        }
    }
}
