//! Calls of code on fields that stay where they are, made ready once.

use std::any::Any;
use std::marker::PhantomData;
use std::sync::Arc;

use super::windows::WindowsList;
use super::{FieldSlice, Fragment, Machine, Scratch};
use crate::float::{BLOCK_BYTES, Float, Precision};
use crate::isa::InstructionSet;
use crate::lower::MaskOutput;
use crate::native::{Arguments, Code};

/// Calls of code on fields that are lent as long as the session lasts: what a call needs is compared and written down when it
/// is bound, so that running it costs next to nothing. Calls have numbers, which the caller chooses. They stay bound from a
/// session to the next one on the same scratch, but for those that have to do with a field that is another one then.
pub struct Session<'a, T> {
    scratch: &'a mut Scratch,
    /// The fields.
    borrowed: PhantomData<FieldSlice<'a, T>>,
}

/// What sessions leave for the next one.
#[derive(Default)]
pub(super) struct Kept {
    /// Whose code is bound.
    owner: Option<Arc<dyn Any + Send + Sync>>,
    /// That of the code that is bound.
    precision: Option<Precision>,
    /// Addresses and tags of the fields that are lent, or were lent last.
    fields: Vec<(usize, usize)>,
    /// Calls by number.
    calls: Vec<Bound>,
}

/// A call. Only what is bound may be run, and only in a session whose fields are those that it was bound to.
struct Bound {
    /// The code and its constants, kept alive; `None`: nothing is bound.
    machine: Option<Arc<Machine>>,
    isa: InstructionSet,
    /// The fields that it has to do with, by their numbers as bits.
    uses: u64,
    /// Number of its fields, and their addresses for every part of the block.
    fields: usize,
    addresses: Vec<usize>,
    /// Number of columns of windows, 0 for code without windows, and the largest start that all fields have room for, by
    /// column.
    columns: usize,
    room: [usize; MOST_COLUMNS],
    /// Bits of the masks returned that the code leaves, and those that are known.
    left: [u32; MASKS],
    known: [u32; MASKS],
}

/// Most masks that a bound call returns. It takes one, or none.
const MASKS: usize = 2;
/// Most fields of a session, and most columns of its windows.
const MOST_FIELDS: usize = u64::BITS as usize;
const MOST_COLUMNS: usize = 16;

impl Bound {
    /// Nothing.
    fn nothing() -> Self {
        Bound {
            machine: None,
            isa: InstructionSet::Avx2,
            uses: 0,
            fields: 0,
            addresses: vec![],
            columns: 0,
            room: [0; MOST_COLUMNS],
            left: [0; MASKS],
            known: [0; MASKS],
        }
    }
}

impl<'a, T: Float> Session<'a, T> {
    /// Lends fields, up to 64, and keeps the calls that were bound to the same ones for the same owner of code, so that numbers
    /// of calls are that owner's own.
    ///
    /// # Panics
    ///
    /// If there are more fields.
    pub fn new<O: Any + Send + Sync>(scratch: &'a mut Scratch, owner: &Arc<O>, fields: &[FieldSlice<'a, T>]) -> Self {
        assert!(fields.len() <= MOST_FIELDS, "{} fields", fields.len());
        let kept = &mut scratch.kept;
        if !kept.owner.as_ref().is_some_and(|known| std::ptr::addr_eq(Arc::as_ptr(known), Arc::as_ptr(owner))) {
            kept.owner = Some(owner.clone());
            kept.calls.clear();
        }
        if kept.precision != Some(T::PRECISION) || kept.fields.len() != fields.len() {
            kept.precision = Some(T::PRECISION);
            kept.fields = vec![(0, 0); fields.len()];
            kept.calls.clear();
        }
        let mut changed = 0;
        for (i, (known, field)) in kept.fields.iter_mut().zip(fields).enumerate() {
            // Exposed: code that was bound in an earlier session uses the address.
            let lent = (field.start.expose_provenance(), field.tag);
            changed |= u64::from(*known != lent) << i;
            *known = lent;
        }
        if changed != 0 {
            for call in kept.calls.iter_mut().filter(|call| call.uses & changed != 0) {
                call.machine = None;
            }
        }
        Session { scratch, borrowed: PhantomData }
    }

    /// Whether a call is bound.
    pub fn has(&self, call: usize) -> bool {
        self.scratch.kept.calls.get(call).is_some_and(|call| call.machine.is_some())
    }

    /// Makes a call of code ready, on fields by their numbers in the session.
    ///
    /// # Panics
    ///
    /// As [`Fragment::run`], but for masks.
    pub fn bind(&mut self, call: usize, fragment: &Fragment<T>, fields: impl Iterator<Item = usize> + Clone) {
        assert!(fragment.columns.is_none(), "code for windows");
        self.put(call, fragment, fields);
    }

    /// Makes a call of code for windows ready, on fields by their numbers in the session.
    ///
    /// # Panics
    ///
    /// As [`Fragment::run_each`], but for masks, with a list of one item that starts at 0 everywhere; if there are more than 16
    /// columns.
    pub fn bind_each(&mut self, call: usize, fragment: &Fragment<T>, fields: impl Iterator<Item = usize> + Clone) {
        let columns = fragment.columns.as_ref().expect("code for windows");
        assert!(columns.width <= MOST_COLUMNS, "too many columns for a session");
        self.put(call, fragment, fields);
    }

    /// Writes a call down, after comparing the fields with what the code wants.
    fn put(&mut self, number: usize, fragment: &Fragment<T>, fields: impl Iterator<Item = usize> + Clone) {
        assert!(fragment.masks_in <= 1 && fragment.masks_out.len() <= MASKS, "too many masks for a session");
        self.scratch.reserve(fragment);
        let Kept { fields: lent, calls, .. } = &mut self.scratch.kept;
        if calls.len() <= number {
            calls.resize_with(number + 1, Bound::nothing);
        }
        let call = &mut calls[number];
        (call.machine, call.uses, call.room) = (None, 0, [usize::MAX; MOST_COLUMNS]);
        call.addresses.clear();
        for run in 0..fragment.runs() {
            let mut count = 0;
            for (field, wanted) in fields.clone().zip(&fragment.wanted) {
                let (start, tag) = lent[field];
                let fits = match call.room.get_mut(wanted.column) {
                    None => wanted.differs(tag) == 0,
                    Some(most) => wanted.room::<T>(tag).is_some_and(|room| {
                        *most = room.min(*most);
                        true
                    }),
                };
                assert!(fits, "field {count} is not what the code wants: {:?}", fragment.fields[count]);
                call.addresses.push(start.wrapping_add(wanted.offsets[run]));
                call.uses |= 1 << field;
                count += 1;
            }
            assert!(count == fragment.wanted.len(), "{count} fields of {}", fragment.wanted.len());
        }
        let all = ((1_u64 << T::PRECISION.lanes()) - 1) as u32;
        let mask = |i: usize| fragment.masks_out.get(i).unwrap_or(&MaskOutput::Known(false));
        call.left = std::array::from_fn(|i| if matches!(mask(i), MaskOutput::Value(_)) { all } else { 0 });
        call.known = std::array::from_fn(|i| if matches!(mask(i), MaskOutput::Known(true)) { all } else { 0 });
        call.isa = fragment.statistics.isa;
        call.fields = fragment.fields.len();
        call.columns = fragment.columns.as_ref().map_or(0, |columns| columns.width);
        call.machine = Some(fragment.machine.clone());
    }

    /// Runs a call, with the bits of a mask, for code that takes one; returns those of the masks that the code returns. Of code that
    /// takes a block part by part, parts without any of `lanes` are left out, and their bits are 0. `None`: it is not bound.
    ///
    /// # Panics
    ///
    /// If the call is one for windows.
    #[inline]
    pub fn run(&mut self, call: usize, mask: u32, lanes: u32) -> Option<[u32; MASKS]> {
        let (call, machine, slots) = self.call(call)?;
        assert!(call.columns == 0, "code for windows");
        // SAFETY: as in `Fragment::run`: `put` has compared the fields, and `call` vouches for the rest.
        Some(run_parts::<T>((call, machine), slots, [mask, lanes], |code, arguments| unsafe { code.run(arguments) }))
    }

    /// Runs a call for windows, with the bits of a mask, for code that takes one, and without parts of the block that have none of
    /// `lanes`. `None`: it is not bound.
    ///
    /// # Panics
    ///
    /// If the call is not one for windows of so many columns, or an item may start so late that a window does not lie within its
    /// field.
    #[inline]
    pub fn run_each<const N: usize>(
        &mut self,
        call: usize,
        [mask, lanes]: [u32; 2],
        windows: WindowsList<'_, N>,
    ) -> Option<()> {
        let (call, machine, slots) = self.call(call)?;
        assert!(call.columns == N && N > 0, "code for windows of other columns");
        // Without a branch for every column.
        let beyond =
            windows.largest.iter().zip(&call.room).fold(false, |beyond, (start, room)| beyond | (start > room));
        assert!(!beyond, "windows beyond their fields");
        if !windows.is_empty() {
            // SAFETY: as in `Fragment::run_each`: `put` has compared the fields, which have room for windows from all starts
            // of the list, and `call` vouches for the rest.
            run_parts::<T>((call, machine), slots, [mask, lanes], |code, arguments| unsafe {
                code.run_each(arguments, windows.offsets.as_flattened());
            });
        }
        Some(())
    }

    /// A call that is bound, its code, and the scratch for it. Its fields are those of the session, which borrows them: `new` has
    /// dropped all calls that had to do with others. The scratch has had room for the code since it was bound.
    #[inline(always)]
    fn call(&mut self, number: usize) -> Option<(&Bound, &Machine, *mut u8)> {
        let Scratch { kept, slots, .. } = &mut *self.scratch;
        let call = kept.calls.get(number)?;
        Some((call, call.machine.as_deref()?, slots.as_mut_ptr().cast()))
    }
}

/// Runs a call on the parts of the block that have some of the lanes.
#[inline(always)]
fn run_parts<T: Float>(
    (call, machine): (&Bound, &Machine),
    slots: *mut u8,
    [mask, wanted]: [u32; 2],
    run: impl Fn(&Code, &Arguments),
) -> [u32; MASKS] {
    let isa = call.isa;
    let lanes = isa.vector_bytes() / T::PRECISION.bytes();
    let slots = slots.wrapping_add(super::bias(isa, isa.vector_bytes()));
    let mut masks = call.known;
    let parts = BLOCK_BYTES / isa.vector_bytes();
    for part in 0..parts {
        let mine = ((1 << lanes) - 1) << (part * lanes);
        if parts > 1 && wanted & mine == 0 {
            masks.iter_mut().for_each(|mask| *mask &= !mine);
            continue;
        }
        let fields = call.addresses[part * call.fields..].as_ptr().cast();
        let (given, mut returned) = ([mask >> (part * lanes)], [0; MASKS]);
        let (masks_in, masks_out) = (given.as_ptr(), returned.as_mut_ptr());
        run(&machine.code, &Arguments { fields, constants: machine.constants(), slots, masks_in, masks_out });
        for (i, mask) in masks.iter_mut().enumerate() {
            *mask |= (returned[i] << (part * lanes)) & call.left[i];
        }
    }
    masks
}

impl<T> std::fmt::Debug for Session<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session").field("fields", &self.scratch.kept.fields.len()).finish_non_exhaustive()
    }
}
