//! A run of code whose fields are lent one after the other.

use std::marker::PhantomData;

use super::windows::WindowsList;
use super::{FieldSlice, Fragment, Scratch};
use crate::float::Float;
use crate::native::Arguments;

/// A run of code that is being made ready: its fields are put in their order, compared with what the code wants, and their
/// addresses written where the code looks for them. With windows in `N` columns, or none.
pub(super) struct Call<'a, T, const N: usize> {
    fragment: &'a Fragment<T>,
    scratch: &'a mut Scratch,
    /// The largest start in every column.
    largest: [usize; N],
    /// Number of fields that were put.
    count: usize,
    borrowed: PhantomData<FieldSlice<'a, T>>,
}

impl<T: Float> Fragment<T> {
    /// A run for windows up to the largest starts of a list, or for none, without any of its fields so far.
    ///
    /// # Panics
    ///
    /// If the code was not compiled for windows of so many columns.
    #[inline(always)]
    fn call<'a, const N: usize>(&'a self, scratch: &'a mut Scratch, largest: &[usize; N]) -> Call<'a, T, N> {
        assert_eq!(self.columns.as_ref().map_or(0, |columns| columns.width), N, "number of columns");
        scratch.reserve(self);
        Call { fragment: self, scratch, largest: *largest, count: 0, borrowed: PhantomData }
    }

    /// The same with fields.
    #[inline(always)]
    pub(super) fn call_with<'a, const N: usize>(
        &'a self,
        scratch: &'a mut Scratch,
        fields: &'a [FieldSlice<'_, T>],
        largest: &[usize; N],
    ) -> Call<'a, T, N> {
        let mut call = self.call(scratch, largest);
        fields.iter().for_each(|field| call.put(field));
        call
    }
}

impl<'a, T: Float, const N: usize> Call<'a, T, N> {
    /// Puts the next field.
    ///
    /// # Panics
    ///
    /// If its kind or length differs from what was recorded, it is written and was lent for reading only, or a window does not
    /// lie within it.
    #[inline(always)]
    fn put(&mut self, field: &'a FieldSlice<'_, T>) {
        let Call { fragment, scratch, largest, count, .. } = self;
        // Those beyond the number of fields show when that is compared.
        if let (Some(wanted), Some(address)) = (fragment.wanted.get(*count), scratch.fields.get_mut(*count)) {
            if !wanted.fits::<T, N>(field.tag, largest) {
                fragment.refuse(*count, field.tag, largest);
            }
            *address = field.start.wrapping_add(wanted.offsets[0]);
        }
        *count += 1;
    }

    /// As [`Fragment::run`].
    ///
    /// # Panics
    ///
    /// As that.
    #[inline]
    pub fn run(self, masks_in: &[u32], masks_out: &mut [u32]) {
        let Call { fragment, scratch, count, .. } = self;
        assert_eq!(N, 0, "code for windows");
        assert_eq!(count, fragment.fields.len(), "number of fields");
        assert_eq!(masks_in.len(), fragment.masks_in, "number of masks given");
        assert_eq!(masks_out.len(), fragment.masks_out.len(), "number of masks returned");
        let isa = fragment.statistics.isa;
        for run in 0..fragment.runs() {
            fragment.advance(run, scratch);
            let arguments = Arguments { fields: scratch.fields.as_ptr(), ..fragment.arguments(scratch, masks_in, run) };
            // SAFETY: kinds, lengths and mutability of all fields have been compared with those that the code was emitted
            // for, in `put`; `Block` types and `Aligned` are aligned to 64 bytes; scratch and constants have the lengths
            // that the code was emitted for; the fields' borrows last until the end of this function, mutable where written
            // to.
            unsafe { fragment.machine.code.runner().run(&arguments) };
            fragment.collect_masks(&scratch.masks_out, run * isa.vector_bytes() / T::PRECISION.bytes(), masks_out);
        }
    }

    /// As [`Fragment::run_each`].
    ///
    /// # Panics
    ///
    /// As that.
    #[inline]
    pub fn run_each(self, masks_in: &[u32], windows: WindowsList<'_, N>) {
        self.check(masks_in.len(), &windows);
        let Call { fragment, scratch, .. } = self;
        for run in 0..fragment.runs() {
            fragment.advance(run, scratch);
            let arguments = Arguments { fields: scratch.fields.as_ptr(), ..fragment.arguments(scratch, masks_in, run) };
            // SAFETY: as in `run`, for windows: kinds and mutability of all fields have been compared, and from the largest
            // start of any item on, every field with windows has the recorded number of entries; the offsets are those starts.
            // The items are as wide as the code was compiled for, and there is one.
            unsafe { fragment.machine.code.runner().run_each(&arguments, windows.offsets.as_flattened()) };
        }
    }

    /// What has to hold of a list beyond what the fields were compared with.
    #[inline(always)]
    fn check(&self, masks_in: usize, windows: &WindowsList<'_, N>) {
        assert!(N > 0 && !windows.is_empty(), "code for windows");
        let beyond =
            windows.largest.iter().zip(&self.largest).fold(false, |beyond, (start, most)| beyond | (start > most));
        assert!(!beyond, "windows beyond those of the call");
        assert_eq!(self.count, self.fragment.fields.len(), "number of fields");
        assert_eq!(masks_in, self.fragment.masks_in, "number of masks given");
    }
}
