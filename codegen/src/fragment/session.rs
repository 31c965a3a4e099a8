//! Calls of code on fields that stay where they are, made ready once.

use std::marker::PhantomData;

use super::windows::WindowsList;
use super::{FieldSlice, Fragment, Scratch, Wanted, grow};
use crate::float::{BLOCK_BYTES, Float};
use crate::isa::InstructionSet;
use crate::lower::MaskOutput;
use crate::native::{Arguments, Code};

/// Calls of code on fields that are lent as long as the session lasts: what a call needs is compared and written down when it
/// is bound, so that running it costs next to nothing.
pub struct Session<'a, T> {
    scratch: &'a mut Scratch,
    /// That of all calls.
    isa: Option<InstructionSet>,
    /// The fields and fragments of the calls.
    borrowed: PhantomData<(FieldSlice<'a, T>, &'a Fragment<T>)>,
}

/// A call that was bound in a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Call(usize);

/// What a bound call runs.
#[derive(Clone, Copy)]
pub(super) struct Bound {
    code: *const Code,
    constants: *const u8,
    /// Where its fields' addresses start, and their number for each part of the block.
    addresses: usize,
    fields: usize,
    /// Number of columns of windows, 0 for code without windows, and place of their largest starts.
    columns: usize,
    largest: usize,
    /// Bits of the masks returned that the code leaves, and those that are known.
    left: [u32; MASKS],
    known: [u32; MASKS],
}

/// Most masks that a bound call returns. It takes one, or none.
const MASKS: usize = 2;

impl<'a, T: Float> Session<'a, T> {
    /// No calls yet.
    pub fn new(scratch: &'a mut Scratch) -> Self {
        scratch.bound.clear();
        scratch.addresses.clear();
        scratch.largest.clear();
        grow(&mut scratch.masks_in, 1, 0);
        grow(&mut scratch.masks_out, MASKS, 0);
        Session { scratch, isa: None, borrowed: PhantomData }
    }

    /// Makes a call of code ready.
    ///
    /// # Panics
    ///
    /// As [`Fragment::run`], but for masks.
    pub fn bind(&mut self, fragment: &'a Fragment<T>, fields: impl Iterator<Item = FieldSlice<'a, T>> + Clone) -> Call {
        assert!(fragment.columns.is_none(), "code for windows");
        self.put(fragment, fields, |wanted, field| wanted.differs(field) == 0);
        self.push(fragment, 0)
    }

    /// Makes a call of code for windows ready, for lists whose items start no later than those of the given one.
    ///
    /// # Panics
    ///
    /// As [`Fragment::run_each`], but for masks.
    pub fn bind_each<const N: usize>(
        &mut self,
        fragment: &'a Fragment<T>,
        fields: impl Iterator<Item = FieldSlice<'a, T>> + Clone,
        windows: WindowsList<'_, N>,
    ) -> Call {
        assert_eq!(fragment.columns.as_ref().map(|columns| columns.width), Some(N), "number of columns");
        self.put(fragment, fields, |wanted, field| windows.fit(wanted, field));
        self.scratch.largest.extend_from_slice(&windows.largest);
        self.push(fragment, N)
    }

    /// Writes down where the fields are, after comparing them with what the code wants.
    #[inline(always)]
    fn put(
        &mut self,
        fragment: &Fragment<T>,
        fields: impl Iterator<Item = FieldSlice<'a, T>> + Clone,
        fits: impl Fn(&Wanted, &FieldSlice<'_, T>) -> bool,
    ) {
        self.scratch.reserve(fragment);
        for run in 0..fragment.runs() {
            let mut count = 0;
            for (field, wanted) in fields.clone().zip(&fragment.wanted) {
                assert!(fits(wanted, &field), "field {count} is not what the code wants: {:?}", fragment.fields[count]);
                self.scratch.addresses.push(wanted.address(&field, run));
                count += 1;
            }
            assert!(count == fragment.wanted.len(), "{count} fields of {}", fragment.wanted.len());
        }
    }

    fn push(&mut self, fragment: &'a Fragment<T>, columns: usize) -> Call {
        assert!(self.isa.is_none_or(|isa| isa == fragment.statistics.isa), "code of another instruction set");
        assert!(fragment.masks_in <= 1 && fragment.masks_out.len() <= MASKS, "too many masks for a session");
        let all = ((1_u64 << T::PRECISION.lanes()) - 1) as u32;
        let mask = |i: usize| fragment.masks_out.get(i).unwrap_or(&MaskOutput::Known(false));
        let left = |i| if matches!(mask(i), MaskOutput::Value(_)) { all } else { 0 };
        let known = |i| if matches!(mask(i), MaskOutput::Known(true)) { all } else { 0 };
        let fields = fragment.fields.len();
        self.scratch.bound.push(Bound {
            code: &raw const fragment.code,
            constants: fragment.constants_address(),
            addresses: self.scratch.addresses.len() - fragment.runs() * fields,
            fields,
            columns,
            largest: self.scratch.largest.len() - columns,
            left: std::array::from_fn(left),
            known: std::array::from_fn(known),
        });
        self.isa = Some(fragment.statistics.isa);
        Call(self.scratch.bound.len() - 1)
    }

    /// The call that is bound next.
    pub fn next(&self) -> Call {
        Call(self.scratch.bound.len())
    }

    /// Runs a call, with the bits of a mask, for code that takes one; returns those of the masks that the code returns.
    ///
    /// # Panics
    ///
    /// If there is no such call in the session, or it is one for windows.
    #[inline]
    pub fn run(&mut self, call: Call, mask: u32) -> [u32; MASKS] {
        let bound = self.scratch.bound[call.0];
        assert!(bound.columns == 0, "code for windows");
        // SAFETY: as in `Fragment::run`: `bind` has compared the fields, whose borrows last as long as the session, and scratch
        // has had room since.
        self.run_parts(&bound, mask, |code, arguments| unsafe { code.run(arguments) })
    }

    /// Runs a call for windows, with the bits of a mask, for code that takes one.
    ///
    /// # Panics
    ///
    /// If there is no such call in the session, it is not one for windows of so many columns, or an item may start later than
    /// those that it was bound for.
    #[inline]
    pub fn run_each<const N: usize>(&mut self, call: Call, mask: u32, windows: WindowsList<'_, N>) {
        let bound = self.scratch.bound[call.0];
        assert!(bound.columns == N, "code for windows of other columns");
        let largest = &self.scratch.largest[bound.largest..][..N];
        assert!(windows.largest.iter().zip(largest).all(|(a, b)| a <= b), "windows that were not bound");
        if !windows.is_empty() {
            // SAFETY: as in `Fragment::run_each`: `bind_each` has compared the fields with windows that start no earlier; the
            // fields' borrows last as long as the session, and scratch has had room since.
            self.run_parts(&bound, mask, |code, arguments| unsafe {
                code.run_each(arguments, windows.offsets.as_flattened());
            });
        }
    }

    #[inline(always)]
    fn run_parts(&mut self, bound: &Bound, mask: u32, run: impl Fn(&Code, &Arguments)) -> [u32; MASKS] {
        let Some(isa) = self.isa else { return bound.known };
        let lanes = isa.vector_bytes() / T::PRECISION.bytes();
        let mut masks = bound.known;
        for part in 0..BLOCK_BYTES / isa.vector_bytes() {
            let addresses = &self.scratch.addresses[bound.addresses + part * bound.fields..];
            let fields = addresses.as_ptr();
            self.scratch.masks_in[0] = mask >> (part * lanes);
            let arguments = Arguments { fields, constants: bound.constants, ..self.scratch.arguments(isa) };
            // SAFETY: `push` has made the pointer from a reference that outlives the session, which is the only one that pushes
            // since the list was cleared.
            run(unsafe { &*bound.code }, &arguments);
            for (i, mask) in masks.iter_mut().enumerate() {
                *mask |= (self.scratch.masks_out[i] << (part * lanes)) & bound.left[i];
            }
        }
        masks
    }
}

impl Call {
    /// The call that was bound so many calls later.
    pub fn later(self, by: usize) -> Call {
        Call(self.0 + by)
    }
}

impl<T> std::fmt::Debug for Session<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session").field("calls", &self.scratch.bound.len()).finish_non_exhaustive()
    }
}
