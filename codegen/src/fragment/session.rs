//! Calls of code on fields that stay where they are, made ready once.

use std::any::Any;
use std::marker::PhantomData;
use std::sync::Arc;

use super::windows::WindowsList;
use super::{FieldSlice, Fragment, MOST_RUNS, Machine, Scratch};
use crate::float::{BLOCK_BYTES, Float, Precision};
use crate::isa::InstructionSet;
use crate::lower::MaskOutput;
use crate::native::{Arguments, Runner};

/// Calls of code on fields that are lent as long as the session lasts: what a call needs is compared and written down when it
/// is bound, so that running it costs next to nothing. Fields and calls have numbers, which the caller chooses. Calls stay bound
/// from a session to the next one on the same scratch: where a field is elsewhere then, they follow it, and where it is of another
/// kind or length, those that have to do with it are dropped. A session may lend fewer fields than calls are bound to; then the
/// others run.
pub struct Session<'a, T> {
    scratch: &'a mut Scratch,
    /// Fields.
    borrowed: PhantomData<FieldSlice<'a, T>>,
}

/// Most masks that [`Session::run`] returns. A call takes one, or none.
const MASKS: usize = 2;
/// Most columns of windows.
const MOST_COLUMNS: usize = 16;
/// Words of a set of fields.
const WORDS: usize = 4;
/// Sets of fields that are remembered.
const SETS: usize = 64;

/// A set of fields, by number.
#[derive(Clone, Copy, Default)]
struct Fields([u64; WORDS]);

impl Fields {
    /// Most fields.
    const MOST: usize = WORDS * u64::BITS as usize;

    #[inline(always)]
    fn add(&mut self, number: usize) {
        self.0[number / 64] |= 1 << (number % 64);
    }

    #[inline(always)]
    fn has(&self, number: usize) -> bool {
        self.0[number / 64] >> (number % 64) & 1 != 0
    }

    #[inline(always)]
    fn includes(&self, others: &Fields) -> bool {
        self.0.iter().zip(others.0).fold(0, |more, (mine, other)| more | (other & !mine)) == 0
    }
}

/// What sessions leave for the next one.
pub(super) struct Kept {
    /// Whose code is bound.
    owner: Option<Arc<dyn Any + Send + Sync>>,
    /// That of the code that is bound.
    precision: Option<Precision>,
    /// Address and tag of every field when it was last lent.
    fields: Box<[(usize, usize); Fields::MOST]>,
    /// Number of the set of fields that the session lends, and its place.
    set: u64,
    place: usize,
    /// Sets that were lent, with their numbers, at places that follow from the sets.
    sets: Box<[(Fields, u64); SETS]>,
    /// Number of sets so far.
    count: u64,
    /// Fields that were lent at several places.
    moving: Fields,
    /// Goes up when a field moves; from 1.
    epoch: u64,
    /// Calls by number.
    calls: Vec<Bound>,
}

impl Default for Kept {
    fn default() -> Self {
        Kept {
            owner: None,
            precision: None,
            fields: Box::new([(0, 0); Fields::MOST]),
            set: 0,
            place: 0,
            sets: Box::new([(Fields::default(), 0); SETS]),
            count: 0,
            moving: Fields::default(),
            epoch: 1,
            calls: vec![],
        }
    }
}

/// A call. Only what is bound may be run, and only in a session that lends all of its fields, whose tags are those that it was
/// bound to, with their addresses as they are then. What every run needs comes first, and takes one line of the cache; then what
/// runs for windows do.
#[repr(C, align(64))]
struct Bound {
    /// Number of the set that was lent when it was last looked whether all of its own are in it; 0: nothing is bound.
    set: u64,
    /// When those that move were last looked up; `u64::MAX` if none does.
    epoch: u64,
    /// Of `machine`: the code, and its constants as it wants their address.
    runner: Option<Runner>,
    constants: *const u8,
    /// The start of `places`.
    addresses: *const usize,
    /// Number of its fields.
    fields: u32,
    /// Number of columns of windows, 0 for code without windows.
    columns: u16,
    /// Whether it returns more masks than fit here.
    many: bool,
    isa: InstructionSet,
    /// Of the first masks returned, the bits that the code leaves, and those that are known.
    left: [u32; MASKS],
    known: [u32; MASKS],
    /// The largest start that all fields have room for, by column.
    room: [usize; MOST_COLUMNS],
    /// The code and its constants, kept alive.
    machine: Option<Arc<Machine>>,
    /// Addresses of its fields for every part of the block.
    places: Vec<usize>,
    /// The fields that it has to do with.
    uses: Fields,
    /// Those of them that may be elsewhere next time.
    moving: Vec<Moving>,
    /// Number of masks that it takes.
    given: usize,
    /// Of all masks returned, the bits that the code leaves, and those that are known.
    masks: Vec<[u32; 2]>,
}

/// A field of a call that may move.
struct Moving {
    /// Its place among those of the call.
    place: usize,
    field: usize,
    /// From its start to the address for each part of the block.
    offsets: [usize; MOST_RUNS],
}

impl Bound {
    /// Nothing.
    fn nothing() -> Self {
        Bound {
            set: 0,
            epoch: 0,
            runner: None,
            constants: std::ptr::null(),
            addresses: std::ptr::null(),
            fields: 0,
            columns: 0,
            many: false,
            isa: InstructionSet::Avx2,
            left: [0; MASKS],
            known: [0; MASKS],
            room: [usize::MAX; MOST_COLUMNS],
            machine: None,
            places: vec![],
            uses: Fields::default(),
            moving: vec![],
            given: 0,
            masks: vec![],
        }
    }

    /// Makes sure that its fields are lent, and looks up those that move. `None`: nothing is bound.
    #[cold]
    #[inline(never)]
    fn enter(&mut self, (lent, set): &(Fields, u64), fields: &[(usize, usize)], epoch: u64) -> Option<()> {
        self.machine.as_ref()?;
        assert!(lent.includes(&self.uses), "a field that is not lent");
        for Moving { place, field, offsets } in &self.moving {
            let start = fields[*field].0;
            let addresses = self.places[*place..].iter_mut().step_by(self.fields as usize);
            for (address, offset) in addresses.zip(offsets) {
                *address = start.wrapping_add(*offset);
            }
        }
        self.addresses = self.places.as_ptr();
        (self.set, self.epoch) = (*set, if self.moving.is_empty() { u64::MAX } else { epoch });
        Some(())
    }
}

impl Kept {
    /// Begins for other code: nothing is bound.
    #[cold]
    fn begin(&mut self, owner: Arc<dyn Any + Send + Sync>, precision: Precision) {
        *self = Kept { owner: Some(owner), precision: Some(precision), ..Kept::default() };
    }

    /// Looks up the number of the set that is lent.
    #[inline(always)]
    fn lend(&mut self, lent: Fields) {
        let [first, second, third, fourth] = lent.0;
        let mixed = first ^ second.rotate_left(21) ^ third.rotate_left(42) ^ fourth.rotate_left(11);
        let place = mixed.wrapping_mul(0x9e37_79b9_7f4a_7c15) as usize >> (u64::BITS - SETS.ilog2());
        let (known, number) = &self.sets[place];
        // Word by word: registers that are wider would have to wait for what was just written.
        let same = known.0[0] == first && known.0[1] == second && known.0[2] == third && known.0[3] == fourth;
        if !same || *number == 0 {
            self.remember(place, lent);
        }
        (self.set, self.place) = (self.sets[place].1, place);
    }

    #[cold]
    fn remember(&mut self, place: usize, lent: Fields) {
        self.count += 1;
        self.sets[place] = (lent, self.count);
    }

    /// A field is elsewhere, or another one.
    #[cold]
    #[inline(never)]
    fn replace(&mut self, field: usize, start: usize, tag: usize) {
        let Kept { fields, moving, epoch, calls, .. } = self;
        let other = fields[field].1 != tag;
        if other || !moving.has(field) {
            for call in calls.iter_mut().filter(|call| call.uses.has(field)) {
                (call.machine, call.runner, call.set) = (None, None, 0);
            }
        }
        if !other {
            moving.add(field);
        }
        *epoch += 1;
        fields[field] = (start, tag);
    }
}

/// A session that is being made: its fields are lent one after the other.
pub struct Lending<'a, T> {
    scratch: &'a mut Scratch,
    lent: Fields,
    borrowed: PhantomData<FieldSlice<'a, T>>,
}

impl<'a, T: Float> Lending<'a, T> {
    /// Lends nothing yet. Calls that were bound for the same owner of code stay, so that numbers of calls are that owner's own.
    #[inline(always)]
    pub fn new<O: Any + Send + Sync>(scratch: &'a mut Scratch, owner: &Arc<O>) -> Self {
        let kept = &mut scratch.kept;
        let same = kept.owner.as_ref().is_some_and(|known| std::ptr::addr_eq(Arc::as_ptr(known), Arc::as_ptr(owner)));
        if !same || kept.precision != Some(T::PRECISION) {
            kept.begin(owner.clone(), T::PRECISION);
        }
        Lending { scratch, lent: Fields::default(), borrowed: PhantomData }
    }

    /// Lends a field under a number.
    ///
    /// # Panics
    ///
    /// If the number is 256 or more.
    #[inline(always)]
    pub fn lend(&mut self, number: usize, field: FieldSlice<'a, T>) {
        // Exposed: code that was bound in an earlier session uses the address.
        let (start, tag) = (field.start.expose_provenance(), field.tag);
        let known = &self.scratch.kept.fields[number];
        if known.0 != start || known.1 != tag {
            self.scratch.kept.replace(number, start, tag);
        }
        self.lent.add(number);
    }

    /// Ready for calls.
    #[inline(always)]
    pub fn finish(self) -> Session<'a, T> {
        self.scratch.kept.lend(self.lent);
        Session { scratch: self.scratch, borrowed: PhantomData }
    }
}

impl<T: Float> Session<'_, T> {
    /// Whether a call is bound.
    pub fn has(&self, call: usize) -> bool {
        self.scratch.kept.calls.get(call).is_some_and(|call| call.machine.is_some())
    }

    /// Makes a call of code ready, on fields by their numbers, each as often as the code has windows into it.
    ///
    /// # Panics
    ///
    /// As [`Fragment::run`] or [`Fragment::run_each`], but for masks, with a list of one item that starts at 0 everywhere; if a
    /// field is not lent, the code takes more than one mask, or has windows in more than 16 columns.
    pub fn bind(&mut self, call: usize, fragment: &Fragment<T>, fields: impl Iterator<Item = usize> + Clone) {
        let columns = fragment.columns.as_ref().map_or(0, |columns| columns.width);
        assert!(columns <= MOST_COLUMNS, "too many columns for a session");
        assert!(fragment.masks_in <= 1, "too many masks for a session");
        self.scratch.reserve(fragment);
        let Kept { fields: known, sets, place: set, calls, moving, .. } = &mut self.scratch.kept;
        if calls.len() <= call {
            calls.resize_with(call + 1, Bound::nothing);
        }
        let bound = &mut calls[call];
        *bound = Bound { columns: columns as u16, ..Bound::nothing() };
        for (place, (field, wanted)) in fields.clone().zip(&fragment.wanted).enumerate() {
            assert!(sets[*set].0.has(field), "field {field} is not lent");
            let fits = match bound.room.get_mut(wanted.column) {
                None => wanted.differs(known[field].1) == 0,
                Some(most) => wanted.room::<T>(known[field].1).is_some_and(|room| {
                    *most = room.min(*most);
                    true
                }),
            };
            assert!(fits, "field {place} is not what the code wants: {:?}", fragment.fields[place]);
            bound.uses.add(field);
            if moving.has(field) {
                bound.moving.push(Moving { place, field, offsets: wanted.offsets });
            }
        }
        for run in 0..fragment.runs() {
            let addresses = fields.clone().zip(&fragment.wanted);
            let address = |(field, wanted): (usize, &super::Wanted)| known[field].0.wrapping_add(wanted.offsets[run]);
            bound.places.extend(addresses.map(address));
        }
        let (wanted, count) = (fragment.fields.len(), bound.places.len() / fragment.runs());
        assert!(count == wanted && fields.count() == count, "{count} fields of {wanted}");
        bound.fields = wanted as u32;
        let all = ((1_u64 << T::PRECISION.lanes()) - 1) as u32;
        let mask = |mask: &MaskOutput| match mask {
            MaskOutput::Value(_) => [all, 0],
            MaskOutput::Known(known) => [0, if *known { all } else { 0 }],
        };
        bound.masks = fragment.masks_out.iter().map(mask).collect();
        let of_first = |which: usize| std::array::from_fn(|i| bound.masks.get(i).map_or(0, |mask| mask[which]));
        (bound.left, bound.known) = (of_first(0), of_first(1));
        bound.many = bound.masks.len() > MASKS;
        bound.given = fragment.masks_in;
        bound.isa = fragment.statistics.isa;
        bound.machine = Some(fragment.machine.clone());
        (bound.runner, bound.constants) = (Some(fragment.machine.code.runner()), fragment.machine.constants());
    }

    /// Runs a call, with the bits of a mask, for code that takes one; returns those of the masks that the code returns, up to two.
    /// Of code that takes a block part by part, parts without any of `lanes` are left out, and their bits are 0. `None`: it is not
    /// bound.
    ///
    /// # Panics
    ///
    /// If the call is one for windows, returns more masks, or a field of it is not lent.
    #[inline(always)]
    pub fn run(&mut self, call: usize, mask: u32, lanes: u32) -> Option<[u32; MASKS]> {
        let Ready { call, runner, slots, .. } = self.call(call)?;
        assert!(call.columns == 0 && !call.many, "code for windows, or that returns more masks");
        // SAFETY: as in `Fragment::run`: `bind` has compared the fields, and `call` vouches for the rest.
        let run = |runner: Runner, arguments: &Arguments| unsafe { runner.run(arguments) };
        let mut masks = call.known;
        Part::each::<T>(call.isa, |part| {
            if part.is_left_out(lanes) {
                masks.iter_mut().for_each(|mask| *mask &= !part.lanes);
                return;
            }
            let (given, mut returned) = ([mask >> part.first], [0; MASKS]);
            part.run((call, runner), slots, (given.as_ptr(), returned.as_mut_ptr()), run);
            for i in 0..MASKS {
                masks[i] |= (written(&returned[i]) << part.first) & call.left[i];
            }
        });
        Some(masks)
    }

    /// The same for code that returns any number of masks, for all of the block.
    ///
    /// # Panics
    ///
    /// Likewise; if there is not one place for every mask returned.
    #[inline]
    pub fn run_into(&mut self, call: usize, mask: u32, returned: &mut [u32]) -> Option<()> {
        let Ready { call, runner, slots, masks_out } = self.call(call)?;
        assert!(call.columns == 0, "code for windows");
        assert_eq!(call.masks.len(), returned.len(), "number of masks returned");
        for (mask, [_, known]) in returned.iter_mut().zip(&call.masks) {
            *mask = *known;
        }
        // SAFETY: as in `run`; the scratch has had room for the masks returned since the call was bound.
        let run = |runner: Runner, arguments: &Arguments| unsafe { runner.run(arguments) };
        Part::each::<T>(call.isa, |part| {
            let given = [mask >> part.first];
            part.run((call, runner), slots, (given.as_ptr(), masks_out.as_mut_ptr()), run);
            for ((mask, word), [left, _]) in returned.iter_mut().zip(&*masks_out).zip(&call.masks) {
                *mask |= (written(word) << part.first) & left;
            }
        });
        Some(())
    }

    /// Runs a call for windows, with the bits of a mask, for code that takes one, and without parts of the block that have none of
    /// `lanes`. `None`: it is not bound.
    ///
    /// # Panics
    ///
    /// If the call is not one for windows of so many columns, an item may start so late that a window does not lie within its
    /// field, or a field is not lent.
    #[inline(always)]
    pub fn run_each<const N: usize>(
        &mut self,
        call: usize,
        [mask, lanes]: [u32; 2],
        windows: WindowsList<'_, N>,
    ) -> Option<()> {
        let Ready { call, runner, slots, .. } = self.call(call)?;
        call.check(&windows);
        if windows.is_empty() {
            return Some(());
        }
        Part::each::<T>(call.isa, |part| {
            if part.is_left_out(lanes) {
                return;
            }
            let given = [mask >> part.first];
            // SAFETY: as in `Fragment::run_each`: `bind` has compared the fields, which have room for windows from all starts
            // of the list, and `call` vouches for the rest.
            part.run((call, runner), slots, (given.as_ptr(), std::ptr::null_mut()), |runner, arguments| unsafe {
                runner.run_each(arguments, windows.offsets.as_flattened());
            });
        });
        Some(())
    }

    /// The same with a mask for every item, for all of the block.
    ///
    /// # Panics
    ///
    /// Likewise, or if there is not one mask for every item.
    #[inline]
    pub fn run_each_masked<const N: usize>(
        &mut self,
        call: usize,
        masks: &[u32],
        windows: WindowsList<'_, N>,
    ) -> Option<()> {
        let Ready { call, runner, slots, .. } = self.call(call)?;
        call.check(&windows);
        assert!(masks.len() == windows.len() && call.given == 1, "number of masks");
        Part::each::<T>(call.isa, |part| {
            for (mask, item) in masks.iter().zip(windows.offsets) {
                let given = [mask >> part.first];
                // SAFETY: as in `run_each`, for one item of the list.
                part.run((call, runner), slots, (given.as_ptr(), std::ptr::null_mut()), |runner, arguments| unsafe {
                    runner.run_each(arguments, item);
                });
            }
        });
        Some(())
    }

    /// A call that is bound, with its fields where they are now. `replace` has dropped all calls that had to do with others; the
    /// session borrows those that are lent. The scratch has had room for the code since it was bound.
    #[inline(always)]
    fn call(&mut self, number: usize) -> Option<Ready<'_>> {
        let Scratch { kept, slots, masks_out, .. } = &mut *self.scratch;
        let Kept { fields, sets, place, set, epoch, calls, .. } = kept;
        let call = calls.get_mut(number)?;
        if call.set != *set || call.epoch < *epoch {
            call.enter(&sets[*place], &fields[..], *epoch)?;
        }
        let runner = call.runner?;
        Some(Ready { runner, slots: slots.as_mut_ptr().cast(), masks_out, call })
    }
}

impl Bound {
    /// What has to hold of windows.
    #[inline(always)]
    fn check<const N: usize>(&self, windows: &WindowsList<'_, N>) {
        assert!(usize::from(self.columns) == N && N > 0, "code for windows of other columns");
        // Without a branch for every column.
        let beyond =
            windows.largest.iter().zip(&self.room).fold(false, |beyond, (start, room)| beyond | (start > room));
        assert!(!beyond, "windows beyond their fields");
    }
}

/// A mask that code has just written, by itself: to read several at once would be to wait until they are in the cache.
#[inline(always)]
fn written(mask: &u32) -> u32 {
    // SAFETY: a reference.
    unsafe { std::ptr::read_volatile(mask) }
}

/// A call that may be run.
struct Ready<'s> {
    call: &'s Bound,
    runner: Runner,
    slots: *mut u8,
    masks_out: &'s mut Vec<u32>,
}

/// The part of a block that a register holds.
struct Part {
    number: usize,
    /// Its first lane, and its lanes as bits.
    first: usize,
    lanes: u32,
    /// Whether it is all of the block.
    alone: bool,
    /// From the start of the slots to where code has them.
    bias: usize,
}

impl Part {
    /// Calls `f` with every part of a block. All that is known of a part is a constant where it is called, as this is inlined.
    #[inline(always)]
    fn each<T: Float>(isa: InstructionSet, mut f: impl FnMut(&Part)) {
        let part = |isa: InstructionSet, number: usize| {
            let (lanes, alone) = (isa.vector_bytes() / T::PRECISION.bytes(), isa.vector_bytes() == BLOCK_BYTES);
            let (first, bias) = (number * lanes, super::bias(isa, isa.vector_bytes()));
            Part { number, first, lanes: ((1 << lanes) - 1) << first, alone, bias }
        };
        match isa {
            InstructionSet::Avx2 => (0..2).for_each(|number| f(&part(InstructionSet::Avx2, number))),
            InstructionSet::Avx512 => f(&part(InstructionSet::Avx512, 0)),
        }
    }

    /// Whether there is nothing to do. Nobody asks that for all of a block.
    #[inline(always)]
    fn is_left_out(&self, wanted: u32) -> bool {
        !self.alone && wanted & self.lanes == 0
    }

    #[inline(always)]
    fn run(
        &self,
        (call, runner): (&Bound, Runner),
        slots: *mut u8,
        (masks_in, masks_out): (*const u32, *mut u32),
        run: impl Fn(Runner, &Arguments),
    ) {
        let slots = slots.wrapping_add(self.bias);
        let fields = call.addresses.wrapping_add(self.number * call.fields as usize).cast();
        run(runner, &Arguments { fields, constants: call.constants, slots, masks_in, masks_out });
    }
}

impl<T> std::fmt::Debug for Lending<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Lending").finish_non_exhaustive()
    }
}

impl<T> std::fmt::Debug for Session<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session").finish_non_exhaustive()
    }
}
