//! From what was recorded to what an instruction set can do: dead values go, negations that are left join what they negate,
//! bit operations replace signs.

use rustc_hash::FxHashMap;

use crate::float::{Float, Precision};
use crate::graph::{Id, Node, Op};
use crate::isa::InstructionSet;
use crate::recording::{FieldStore, Program};

/// A mask that a fragment returns.
#[derive(Clone, Copy, Debug)]
pub(crate) enum MaskOutput {
    Known(bool),
    Value(Id),
}

/// Live values, operands before what uses them but for constants, and where they go.
pub(crate) struct Lowered {
    pub nodes: Vec<Node>,
    pub stores: Vec<FieldStore>,
    pub masks_out: Vec<MaskOutput>,
}

/// Lowers the program.
pub(crate) fn lower<T: Float>(program: &Program<T>, isa: InstructionSet) -> Lowered {
    let graph = &program.graph.nodes;
    let known_mask = |id: &Id| program.graph.known(*id);
    let roots = program.stores.iter().map(|s| s.value);
    let roots = roots.chain(program.masks_out.iter().copied().filter(|id| known_mask(id).is_none()));
    let mut uses = vec![0_u32; graph.len()];
    roots.for_each(|id| uses[id as usize] += 1);
    for (i, node) in graph.iter().enumerate().rev() {
        if uses[i] > 0 {
            node.operands().iter().for_each(|x| uses[*x as usize] += 1);
        }
    }
    let mut lowering = Lowering { isa, precision: T::PRECISION, nodes: vec![], constants: FxHashMap::default() };
    drop_merged(graph, &mut uses);
    let mut map = vec![Id::MAX; graph.len()];
    for (i, node) in graph.iter().enumerate() {
        if uses[i] > 0 {
            map[i] = lowering.node(graph, &map, *node);
        }
    }
    let stores = program.stores.iter().map(|s| FieldStore { value: map[s.value as usize], ..*s }).collect();
    let mask = |id: &Id| known_mask(id).map_or_else(|| MaskOutput::Value(map[*id as usize]), MaskOutput::Known);
    let masks_out = program.masks_out.iter().map(mask).collect();
    let mut lowered = Lowered { nodes: lowering.nodes, stores, masks_out };
    lowered.detach_moved_inputs();
    lowered
}

struct Lowering {
    isa: InstructionSet,
    precision: Precision,
    nodes: Vec<Node>,
    constants: FxHashMap<u64, Id>,
}

impl Lowering {
    fn put(&mut self, op: Op, args: [u32; 3]) -> Id {
        self.nodes.push(Node { op, args });
        self.nodes.len() as Id - 1
    }

    fn constant(&mut self, bits: u64) -> Id {
        *self.constants.entry(bits).or_insert_with(|| {
            self.nodes.push(Node::constant(bits));
            self.nodes.len() as Id - 1
        })
    }

    /// The other bits.
    fn inverted(&mut self, id: Id) -> Id {
        let ones = self.constant(self.precision.ones());
        self.put(Op::BitXor, [id, ones, 0])
    }

    fn node(&mut self, graph: &[Node], map: &[Id], node: Node) -> Id {
        if let (Op::Neg | Op::MaskNot, inner) = (node.op, node.args[0] as usize) {
            // Merged values were given no node. A comparison with other uses is made twice, as cheap as inverting it.
            let merges = map[inner] == Id::MAX || graph[inner].op.negated_comparison().is_some();
            if let Some(merged) = negated(graph, graph[inner]).filter(|_| merges) {
                return self.node(graph, map, merged);
            }
        }
        if node.op == Op::Constant {
            return self.constant(node.bits());
        }
        let mut args = node.args;
        args[..node.op.arity()].iter_mut().for_each(|x| *x = map[*x as usize]);
        match node.op {
            Op::Mul if node.args[2] == NEGATED_CONSTANT => {
                let k = args.map(|x| x as usize)[..2].iter().position(|x| self.nodes[*x].op == Op::Constant);
                let k = k.unwrap_or_default();
                let bits = self.nodes[args[k] as usize].bits() ^ self.precision.sign();
                args[k] = self.constant(bits);
                self.put(Op::Mul, [args[0], args[1], 0])
            }
            Op::Neg => {
                let sign = self.constant(self.precision.sign());
                self.put(Op::BitXor, [args[0], sign, 0])
            }
            Op::Abs => {
                let rest = self.constant(self.precision.ones() ^ self.precision.sign());
                self.put(Op::BitAnd, [args[0], rest, 0])
            }
            op if self.isa.has_mask_registers() => self.put(op, args),
            Op::MaskAnd => self.put(Op::BitAnd, args),
            Op::MaskOr => self.put(Op::BitOr, args),
            Op::MaskDiffer => self.put(Op::BitXor, args),
            Op::MaskSame => {
                let differ = self.put(Op::BitXor, args);
                self.inverted(differ)
            }
            Op::MaskNot => self.inverted(args[0]),
            op => self.put(op, args),
        }
    }
}

/// Makes values unused that only a negation uses and that merge with it.
fn drop_merged(graph: &[Node], uses: &mut [u32]) {
    for (i, node) in graph.iter().enumerate() {
        let inner = node.args[0] as usize;
        if uses[i] > 0 && matches!(node.op, Op::Neg | Op::MaskNot) && uses[inner] == 1 {
            uses[inner] = u32::from(negated(graph, graph[inner]).is_none());
        }
    }
}

/// In the third argument of a product: its constant factor is to be negated.
const NEGATED_CONSTANT: u32 = 1;

/// What computes the opposite of the node's value in one operation, if something does.
fn negated(graph: &[Node], node: Node) -> Option<Node> {
    let [a, b, _] = node.args;
    if let Some((product, addend)) = node.op.fused_signs() {
        return Some(Node { op: Op::fused(!product, !addend), ..node });
    }
    match node.op {
        Op::Sub => Some(Node { args: [b, a, 0], ..node }),
        Op::MaskDiffer => Some(Node { op: Op::MaskSame, ..node }),
        Op::Mul if [a, b].iter().any(|x| graph[*x as usize].op == Op::Constant) => {
            Some(Node { args: [a, b, NEGATED_CONSTANT], ..node })
        }
        op => op.negated_comparison().map(|op| Node { op, ..node }),
    }
}
