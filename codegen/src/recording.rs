//! Recording: binding fields, running kernels over recorders, and what comes out of it.

use std::marker::PhantomData;

use crate::float::Float;
use crate::graph::{Graph, Id, Op};
use crate::recorder::{self, Recorder, RecorderMask, with_graph};

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldKind {
    /// Lane values.
    Lanes,
    /// Numbers that all worlds share.
    Uniform,
}

/// A field as a fragment uses it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldUse {
    /// What it holds.
    pub kind: FieldKind,
    /// Number of entries.
    pub len: usize,
    /// Whether the fragment writes to it.
    pub written: bool,
}

/// A recording in progress on this thread. Bind inputs, run kernels over the [`Recorder`]s, bind outputs, then
/// [`finish`](Recording::finish). Dropping it, in the course of a panic too, throws away what was recorded.
///
/// Fields are numbered by the caller; a fragment's fields are those from 0 to the highest number bound, and numbers left
/// out are fields of length 0.
pub struct Recording<T: Float> {
    /// With the first of its leaves.
    fields: Vec<Option<(FieldUse, Option<Id>)>>,
    outputs: Vec<(u32, Vec<Id>)>,
    masks_in: u32,
    masks_out: Vec<Id>,
    /// Not `Send`: the graph belongs to this thread.
    thread: PhantomData<*const T>,
}

impl<T: Float> Recording<T> {
    /// Opens a recording.
    ///
    /// # Panics
    ///
    /// If another one is open on this thread.
    #[allow(clippy::new_without_default)] // opening a recording has an effect
    pub fn new() -> Self {
        recorder::open(T::PRECISION);
        Recording { fields: vec![], outputs: vec![], masks_in: 0, masks_out: vec![], thread: PhantomData }
    }

    /// The same, which gives up beyond so many operations: the program is [too large](Program::is_too_large) then.
    ///
    /// # Panics
    ///
    /// As [`new`](Recording::new).
    pub fn with_limit(operations: usize) -> Self {
        let recording = Recording::new();
        with_graph::<T, _>(|graph| graph.limit = operations);
        recording
    }

    /// A value that nothing recorded may depend on.
    pub fn unknown(&mut self) -> Recorder<T> {
        Recorder::new(with_graph::<T, _>(|graph| graph.put(Op::Input, [UNKNOWN, 0, 0])))
    }

    /// The `len` lane values that the field holds when the fragment starts.
    ///
    /// # Panics
    ///
    /// If the field has been bound with another length or kind.
    pub fn input(&mut self, field: usize, len: usize) -> Vec<Recorder<T>> {
        self.bind(field, FieldKind::Lanes, len);
        self.leaves(Op::Input, field, len)
    }

    /// The numbers of a field of `len` numbers that all worlds share.
    ///
    /// # Panics
    ///
    /// If the field has been bound with another length or kind.
    pub fn uniform(&mut self, field: usize, len: usize) -> Vec<Recorder<T>> {
        self.bind(field, FieldKind::Uniform, len);
        self.leaves(Op::Uniform, field, len)
    }

    /// What the field shall hold when the fragment ends; a second binding replaces the first. Entries that are the
    /// field's own inputs stay as they are, and if all are, the field is not written.
    ///
    /// # Panics
    ///
    /// If the field has been bound with another length or as uniform.
    pub fn output(&mut self, field: usize, values: &[Recorder<T>]) {
        self.bind(field, FieldKind::Lanes, values.len());
        self.outputs.retain(|(other, _)| *other as usize != field);
        self.outputs.push((field as u32, values.iter().map(|v| v.id).collect()));
    }

    /// The next mask that is given to the fragment as bits.
    pub fn mask_input(&mut self) -> RecorderMask<T> {
        let index = self.masks_in;
        self.masks_in += 1;
        RecorderMask::new(with_graph::<T, _>(|g| g.put(Op::MaskInput, [index, 0, 0])))
    }

    /// Makes the fragment return the mask as bits; returns its place among those returned.
    pub fn mask_output(&mut self, mask: RecorderMask<T>) -> usize {
        self.masks_out.push(mask.id);
        self.masks_out.len() - 1
    }

    /// Ends the recording.
    pub fn finish(mut self) -> Program<T> {
        let graph = recorder::close();
        let mut stores = vec![];
        for (field, values) in std::mem::take(&mut self.outputs) {
            for (lane, value) in values.into_iter().enumerate() {
                let node = graph.node(value);
                if node.op != Op::Input || node.args[..2] != [field, lane as u32] {
                    stores.push(FieldStore { field, lane: lane as u32, value });
                }
            }
        }
        let unused = FieldUse { kind: FieldKind::Lanes, len: 0, written: false };
        let mut fields: Vec<FieldUse> =
            self.fields.iter().map(|field| field.map_or(unused, |(field, _)| field)).collect();
        for store in &stores {
            fields[store.field as usize].written = true;
        }
        let masks_out = std::mem::take(&mut self.masks_out);
        Program { graph, fields, stores, masks_in: self.masks_in as usize, masks_out, real: PhantomData }
    }

    fn bind(&mut self, field: usize, kind: FieldKind, len: usize) {
        if self.fields.len() <= field {
            self.fields.resize(field + 1, None);
        }
        let (bound, _) = *self.fields[field].get_or_insert((FieldUse { kind, len, written: false }, None));
        assert!(bound.kind == kind && bound.len == len, "field {field} is bound as {bound:?}, not {kind:?} of {len}");
    }

    fn leaves(&mut self, op: Op, field: usize, len: usize) -> Vec<Recorder<T>> {
        let Some((_, first)) = &mut self.fields[field] else { return vec![] };
        let leaves = || with_graph::<T, _>(|g| g.leaves(op, (0..len as u32).map(|i| [field as u32, i, 0])));
        let first = *first.get_or_insert_with(leaves);
        (first..first + len as Id).map(Recorder::new).collect()
    }
}

impl<T: Float> Drop for Recording<T> {
    fn drop(&mut self) {
        // After `finish` nothing is open, and a new recording cannot have been opened since.
        recorder::close();
    }
}

/// Number of the field of what nothing may depend on.
const UNKNOWN: u32 = u32::MAX;

/// A value to be stored.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FieldStore {
    pub field: u32,
    pub lane: u32,
    pub value: Id,
}

/// What was recorded, to be compiled for any instruction set.
pub struct Program<T> {
    pub(crate) graph: Graph,
    pub(crate) fields: Vec<FieldUse>,
    pub(crate) stores: Vec<FieldStore>,
    pub(crate) masks_in: usize,
    pub(crate) masks_out: Vec<Id>,
    real: PhantomData<T>,
}

impl<T: Float> Program<T> {
    /// The fields that a fragment wants, by number.
    pub fn fields(&self) -> &[FieldUse] {
        &self.fields
    }

    /// Number of masks that a fragment takes and returns.
    pub fn masks(&self) -> (usize, usize) {
        (self.masks_in, self.masks_out.len())
    }

    /// Whether there were more operations than the recording's limit: it is of no use then.
    pub fn is_too_large(&self) -> bool {
        self.graph.beyond.is_some()
    }

    /// The fields that it has to do with, by number: what it reads and writes.
    ///
    /// # Panics
    ///
    /// If something depends on an [unknown](Recording::unknown) value.
    pub fn uses(&self) -> Vec<usize> {
        let mut live = vec![false; self.graph.nodes.len()];
        let mut uses = vec![false; self.fields.len()];
        for root in self.stores.iter().map(|store| store.value).chain(self.masks_out.iter().copied()) {
            live[root as usize] = true;
        }
        self.stores.iter().for_each(|store| uses[store.field as usize] = true);
        for id in (0..live.len()).rev() {
            if !live[id] {
                continue;
            }
            let node = &self.graph.nodes[id];
            node.operands().iter().for_each(|operand| live[*operand as usize] = true);
            if matches!(node.op, Op::Input | Op::Uniform) {
                assert!(node.args[0] != UNKNOWN, "what was recorded depends on a value that it was not given");
                uses[node.args[0] as usize] = true;
            }
        }
        (0..uses.len()).filter(|field| uses[*field]).collect()
    }

    /// Numbers the fields anew: those of a list, which has all that it [uses](Program::uses), in that order.
    pub fn renumber(&mut self, fields: &[usize]) {
        let mut place = vec![UNKNOWN; self.fields.len()];
        fields.iter().zip(0..).for_each(|(field, new)| place[*field] = new);
        for node in self.graph.nodes.iter_mut().filter(|node| matches!(node.op, Op::Input | Op::Uniform)) {
            if node.args[0] != UNKNOWN {
                node.args[0] = place[node.args[0] as usize];
            }
        }
        self.stores.iter_mut().for_each(|store| store.field = place[store.field as usize]);
        self.fields = fields.iter().map(|field| self.fields[*field]).collect();
    }

    /// Number of different values recorded, used or not.
    pub fn nodes(&self) -> usize {
        self.graph.nodes.len()
    }
}

impl<T> std::fmt::Debug for Program<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Program").field("nodes", &self.graph.nodes.len()).finish_non_exhaustive()
    }
}
