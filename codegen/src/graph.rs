//! Operations and their graph.

use rustc_hash::FxHashMap;

/// Index of a node: a value of the fragment.
pub(crate) type Id = u32;

/// Kinds of operations. Arguments are node ids unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Op {
    /// Lane value of a field: field, lane.
    Input,
    /// Number of a uniform field, in every lane: field, index.
    Uniform,
    /// Number, in every lane: low and high half of its bits.
    Constant,
    /// Mask given as bits: index.
    MaskInput,
    /// Mask that holds everywhere or nowhere: 1 or 0.
    MaskConstant,
    /// a + b.
    Add,
    /// a - b.
    Sub,
    /// a b.
    Mul,
    /// a / b.
    Div,
    /// a < b ? a : b.
    Min,
    /// a > b ? a : b.
    Max,
    /// Bits of a and b.
    BitAnd,
    /// Bits of a or b.
    BitOr,
    /// Bits of either a or b.
    BitXor,
    /// Bits of a minus bits of b, as integers.
    IntegerSub,
    /// Bits of a shifted left: a, number of bits.
    ShiftLeft,
    /// Bits of a shifted right, zeros entering: a, number of bits.
    ShiftRight,
    /// a.
    Copy,
    /// -a.
    Neg,
    /// |a|.
    Abs,
    /// √a.
    Sqrt,
    /// Nearest integer, ties to even.
    Round,
    /// a b + c, rounded once.
    MulAdd,
    /// c - a b, rounded once.
    NegMulAdd,
    /// a b - c, rounded once.
    MulSub,
    /// -(a b) - c, rounded once.
    NegMulSub,
    /// a < b.
    Less,
    /// a <= b.
    LessEqual,
    /// a == b.
    Equal,
    /// !(a < b).
    NotLess,
    /// !(a <= b).
    NotLessEqual,
    /// a != b.
    NotEqual,
    /// Mask a and mask b.
    MaskAnd,
    /// Mask a or mask b.
    MaskOr,
    /// Mask a or mask b, not both.
    MaskDiffer,
    /// Both masks, a and b, or neither.
    MaskSame,
    /// Not mask a.
    MaskNot,
    /// b where mask a holds, else c.
    Select,
}

impl Op {
    /// Number of arguments that are nodes.
    pub(crate) fn arity(self) -> usize {
        use Op::*;
        match self {
            Input | Uniform | Constant | MaskInput | MaskConstant => 0,
            ShiftLeft | ShiftRight | Copy | Neg | Abs | Sqrt | Round | MaskNot => 1,
            Add | Sub | Mul | Div | Min | Max | BitAnd | BitOr | BitXor | IntegerSub => 2,
            Less | LessEqual | Equal | NotLess | NotLessEqual | NotEqual => 2,
            MaskAnd | MaskOr | MaskDiffer | MaskSame => 2,
            MulAdd | NegMulAdd | MulSub | NegMulSub | Select => 3,
        }
    }

    /// Whether the value is there without computing it.
    pub(crate) fn is_leaf(self) -> bool {
        self.arity() == 0
    }

    /// Whether the value is a mask.
    pub(crate) fn is_mask(self) -> bool {
        use Op::*;
        let combined = matches!(self, MaskAnd | MaskOr | MaskDiffer | MaskSame | MaskNot);
        combined || matches!(self, MaskInput | MaskConstant) || self.negated_comparison().is_some()
    }

    /// The comparison that holds where this one does not.
    pub(crate) fn negated_comparison(self) -> Option<Op> {
        match self {
            Op::Less => Some(Op::NotLess),
            Op::LessEqual => Some(Op::NotLessEqual),
            Op::Equal => Some(Op::NotEqual),
            Op::NotLess => Some(Op::Less),
            Op::NotLessEqual => Some(Op::LessEqual),
            Op::NotEqual => Some(Op::Equal),
            _ => None,
        }
    }

    /// For fused operations, whether the product and whether the addend is negated.
    pub(crate) fn fused_signs(self) -> Option<(bool, bool)> {
        match self {
            Op::MulAdd => Some((false, false)),
            Op::NegMulAdd => Some((true, false)),
            Op::MulSub => Some((false, true)),
            Op::NegMulSub => Some((true, true)),
            _ => None,
        }
    }

    /// The fused operation with the given signs.
    pub(crate) fn fused(negate_product: bool, negate_addend: bool) -> Op {
        match (negate_product, negate_addend) {
            (false, false) => Op::MulAdd,
            (true, false) => Op::NegMulAdd,
            (false, true) => Op::MulSub,
            (true, true) => Op::NegMulSub,
        }
    }
}

/// A value: an operation and its arguments, unused ones zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Node {
    pub op: Op,
    pub args: [u32; 3],
}

impl Node {
    pub fn constant(bits: u64) -> Node {
        Node { op: Op::Constant, args: [bits as u32, (bits >> 32) as u32, 0] }
    }

    /// Bits of a constant.
    pub fn bits(&self) -> u64 {
        u64::from(self.args[0]) | u64::from(self.args[1]) << 32
    }

    /// The arguments that are nodes.
    pub fn operands(&self) -> &[Id] {
        &self.args[..self.op.arity()]
    }
}

/// Nodes, every one different from the others, operands before what uses them.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    pub nodes: Vec<Node>,
    index: FxHashMap<Node, Id>,
    /// Most nodes beside leaves; 0: any number.
    pub limit: usize,
    leaves: usize,
    /// Once there would have been more nodes, a value and a mask that stand for all others.
    pub beyond: Option<[Id; 2]>,
}

impl Graph {
    /// The node, found or new.
    pub fn put(&mut self, op: Op, args: [u32; 3]) -> Id {
        self.put_node(Node { op, args })
    }

    /// New leaves, as many as `args` gives arguments for; returns the first.
    pub fn leaves(&mut self, op: Op, args: impl Iterator<Item = [u32; 3]>) -> Id {
        let first = self.nodes.len();
        self.nodes.extend(args.map(|args| Node { op, args }));
        self.leaves += self.nodes.len() - first;
        first as Id
    }

    /// What stands for nodes beyond the limit.
    #[cold]
    fn beyond(&mut self, op: Op) -> Id {
        let nodes = &mut self.nodes;
        let [value, mask] = *self.beyond.get_or_insert_with(|| {
            nodes.push(Node::constant(0));
            nodes.push(Node { op: Op::MaskConstant, args: [0; 3] });
            [nodes.len() as Id - 2, nodes.len() as Id - 1]
        });
        if op.is_mask() { mask } else { value }
    }

    fn put_node(&mut self, node: Node) -> Id {
        if self.limit != 0 && self.nodes.len() - self.leaves >= self.limit {
            return self.beyond(node.op);
        }
        *self.index.entry(node).or_insert_with(|| {
            self.nodes.push(node);
            self.nodes.len() as Id - 1
        })
    }

    /// The constant of the given bits.
    pub fn bits(&mut self, bits: u64) -> Id {
        self.put_node(Node::constant(bits))
    }

    /// The node's operation and arguments.
    pub fn node(&self, id: Id) -> Node {
        self.nodes[id as usize]
    }

    /// The argument of the node if its operation is `op`.
    pub fn argument_of(&self, id: Id, op: Op) -> Option<Id> {
        let node = self.node(id);
        (node.op == op).then_some(node.args[0])
    }
}
