//! Rules by which operations are simplified while they are recorded.
//!
//! Every rule leaves the bits that the scalar lane computes as they are, except for the signs of zeros and, where the
//! table says so, for numbers that are not finite (inputs are taken to be finite). `K` is a constant, `x`, `y`, `z` are
//! any values.
//!
//! | rule | exact but for |
//! |---|---|
//! | an operation on constants becomes its result, computed by the scalar lane | |
//! | the constant -0 becomes +0 | sign of zero |
//! | x + 0, x - 0, 0 - x become x, x, -x | sign of zero |
//! | x 0 becomes 0; fma(x, 0, y) becomes y | sign of zero; x infinite or NaN |
//! | fma(x, y, 0) becomes x y | sign of zero |
//! | x 1, x (-1), x / 1, x / (-1) become x or -x; fma(x, ±1, y) becomes y ± x | |
//! | fma(K, K', y) becomes y + K K' if the product is exact | |
//! | x / K becomes x (1/K) if K is a power of two | |
//! | negations of operands of sums, products, quotients and fused operations move into the operation or its result | sign of zero |
//! | K x with negative K becomes -((-K) x) | |
//! | -(-x), abs(-x), abs(abs x), round(round x) lose the inner operation | |
//! | min(x, x), max(x, x), select(m, x, x) become x; x < x is false | |
//! | select of a constant mask, of a negated mask, and of a select with the same mask | |
//! | and, or, not with constants or with themselves | |
//! | (m and n) or (not m and not n) becomes one operation, with negations of m or n too | |
//! | a negation that is left is merged into the sum, product or fused operation that it alone uses (`lower`) | sign of zero |
//! | x y = y x and x + y = y + x share a node (min and max do not commute: NaN and zeros) | |

use crate::float::Float;
use crate::graph::{Graph, Id, Op};

fn sorted(a: Id, b: Id) -> [u32; 3] {
    [a.min(b), a.max(b), 0]
}

impl Graph {
    /// The constant `x`, of zeros the positive one.
    pub fn constant<T: Float>(&mut self, x: T) -> Id {
        self.bits(if x == T::default() { 0 } else { x.bits() })
    }

    /// The number, if the node is a constant.
    pub fn value<T: Float>(&self, id: Id) -> Option<T> {
        let node = self.node(id);
        (node.op == Op::Constant).then(|| T::of_bits(node.bits()))
    }

    fn is<T: Float>(&self, id: Id, x: f64) -> bool {
        self.value::<T>(id).is_some_and(|k| k == T::from_f64(x))
    }

    fn negated(&self, id: Id) -> Option<Id> {
        self.argument_of(id, Op::Neg)
    }

    /// The value without its negation or, if it is a constant, its sign; and whether there was one.
    fn magnitude<T: Float>(&mut self, id: Id) -> (Id, bool) {
        if let Some(inner) = self.negated(id) {
            return (inner, true);
        }
        match self.value::<T>(id) {
            Some(x) if x < T::default() => (self.constant(-x), true),
            _ => (id, false),
        }
    }

    fn negate_if<T: Float>(&mut self, condition: bool, id: Id) -> Id {
        if condition { self.neg::<T>(id) } else { id }
    }

    pub fn neg<T: Float>(&mut self, a: Id) -> Id {
        if let Some(x) = self.value::<T>(a) {
            return self.constant(-x);
        }
        self.negated(a).unwrap_or_else(|| self.put(Op::Neg, [a, 0, 0]))
    }

    pub fn add<T: Float>(&mut self, a: Id, b: Id) -> Id {
        if let (Some(x), Some(y)) = (self.value::<T>(a), self.value::<T>(b)) {
            return self.constant(x + y);
        }
        if self.is::<T>(a, 0.0) {
            return b;
        }
        if self.is::<T>(b, 0.0) {
            return a;
        }
        match (self.negated(a), self.negated(b)) {
            (_, Some(b)) => self.sub::<T>(a, b),
            (Some(a), None) => self.sub::<T>(b, a),
            (None, None) => self.put(Op::Add, sorted(a, b)),
        }
    }

    pub fn sub<T: Float>(&mut self, a: Id, b: Id) -> Id {
        if let (Some(x), Some(y)) = (self.value::<T>(a), self.value::<T>(b)) {
            return self.constant(x - y);
        }
        if self.is::<T>(b, 0.0) {
            return a;
        }
        if self.is::<T>(a, 0.0) {
            return self.neg::<T>(b);
        }
        match (self.negated(a), self.negated(b)) {
            (_, Some(b)) => self.add::<T>(a, b),
            (Some(a), None) => {
                let sum = self.add::<T>(a, b);
                self.neg::<T>(sum)
            }
            (None, None) => self.put(Op::Sub, [a, b, 0]),
        }
    }

    pub fn mul<T: Float>(&mut self, a: Id, b: Id) -> Id {
        if let (Some(x), Some(y)) = (self.value::<T>(a), self.value::<T>(b)) {
            return self.constant(x * y);
        }
        if self.is::<T>(a, 0.0) || self.is::<T>(b, 0.0) {
            return self.constant(T::default());
        }
        let ((a, negate_a), (b, negate_b)) = (self.magnitude::<T>(a), self.magnitude::<T>(b));
        let product = if self.is::<T>(a, 1.0) {
            b
        } else if self.is::<T>(b, 1.0) {
            a
        } else {
            self.put(Op::Mul, sorted(a, b))
        };
        self.negate_if::<T>(negate_a != negate_b, product)
    }

    pub fn div<T: Float>(&mut self, a: Id, b: Id) -> Id {
        if let (Some(x), Some(y)) = (self.value::<T>(a), self.value::<T>(b)) {
            return self.constant(x / y);
        }
        let ((a, negate_a), (b, negate_b)) = (self.magnitude::<T>(a), self.magnitude::<T>(b));
        let inverse = self.value::<T>(b).and_then(exact_inverse);
        let quotient = match inverse {
            Some(inverse) => {
                let inverse = self.constant(inverse);
                self.mul::<T>(a, inverse)
            }
            None => self.put(Op::Div, [a, b, 0]),
        };
        self.negate_if::<T>(negate_a != negate_b, quotient)
    }

    /// ±(a b) ± c.
    pub fn fused<T: Float>(&mut self, a: Id, b: Id, c: Id, negate_product: bool) -> Id {
        let ((a, negate_a), (b, negate_b)) = (self.magnitude::<T>(a), self.magnitude::<T>(b));
        let negative = negate_product ^ negate_a ^ negate_b;
        let product = match (self.value::<T>(a), self.value::<T>(b)) {
            (Some(x), Some(y)) => {
                if let Some(z) = self.value::<T>(c) {
                    return self.constant(if negative { x.neg_mul_add(y, z) } else { x.mul_add(y, z) });
                }
                exact_product(x, y).map(|product| self.constant(product))
            }
            (Some(x), None) if x == T::default() => Some(a),
            (None, Some(y)) if y == T::default() => Some(b),
            (Some(x), None) if x == T::from_f64(1.0) => Some(b),
            (None, Some(y)) if y == T::from_f64(1.0) => Some(a),
            _ if self.is::<T>(c, 0.0) => Some(self.mul::<T>(a, b)),
            _ => None,
        };
        match (product, negative) {
            (Some(product), false) => self.add::<T>(product, c),
            (Some(product), true) => self.sub::<T>(c, product),
            (None, _) => {
                let (c, subtract) = self.negated(c).map_or((c, false), |c| (c, true));
                let [a, b, _] = sorted(a, b);
                self.put(Op::fused(negative, subtract), [a, b, c])
            }
        }
    }

    pub fn sqrt<T: Float>(&mut self, a: Id) -> Id {
        match self.value::<T>(a) {
            Some(x) => self.constant(x.sqrt()),
            None => self.put(Op::Sqrt, [a, 0, 0]),
        }
    }

    pub fn round<T: Float>(&mut self, a: Id) -> Id {
        match self.value::<T>(a) {
            Some(x) => self.constant(x.round()),
            None if self.node(a).op == Op::Round => a,
            None => self.put(Op::Round, [a, 0, 0]),
        }
    }

    pub fn abs<T: Float>(&mut self, a: Id) -> Id {
        let a = self.negated(a).unwrap_or(a);
        match self.value::<T>(a) {
            Some(x) => self.constant(x.abs()),
            None if self.node(a).op == Op::Abs => a,
            None => self.put(Op::Abs, [a, 0, 0]),
        }
    }

    /// `op` is `Min` or `Max`.
    pub fn extremum<T: Float>(&mut self, op: Op, a: Id, b: Id) -> Id {
        match (self.value::<T>(a), self.value::<T>(b)) {
            (Some(x), Some(y)) => self.constant(if op == Op::Min { x.min(y) } else { x.max(y) }),
            _ if a == b => a,
            _ => self.put(op, [a, b, 0]),
        }
    }

    /// `op` is `Less`, `LessEqual` or `Equal`.
    pub fn compare<T: Float>(&mut self, op: Op, a: Id, b: Id) -> Id {
        match (self.value::<T>(a), self.value::<T>(b)) {
            (Some(x), Some(y)) => self.truth(match op {
                Op::Less => x < y,
                Op::LessEqual => x <= y,
                _ => x == y,
            }),
            _ if a == b && op == Op::Less => self.truth(false),
            _ if op == Op::Equal => self.put(op, sorted(a, b)),
            _ => self.put(op, [a, b, 0]),
        }
    }

    pub fn truth(&mut self, x: bool) -> Id {
        self.put(Op::MaskConstant, [u32::from(x), 0, 0])
    }

    /// The value of a constant mask.
    pub fn known(&self, mask: Id) -> Option<bool> {
        self.argument_of(mask, Op::MaskConstant).map(|x| x != 0)
    }

    pub fn not(&mut self, a: Id) -> Id {
        if let Some(x) = self.known(a) {
            return self.truth(!x);
        }
        self.argument_of(a, Op::MaskNot).unwrap_or_else(|| self.put(Op::MaskNot, [a, 0, 0]))
    }

    /// `op` is `MaskAnd` or `MaskOr`.
    pub fn combine(&mut self, op: Op, a: Id, b: Id) -> Id {
        let neutral = op == Op::MaskAnd;
        match (self.known(a), self.known(b)) {
            (Some(x), _) => return if x == neutral { b } else { a },
            (_, Some(y)) => return if y == neutral { a } else { b },
            _ => {}
        }
        if let Some(same) = Some(op).filter(|op| *op == Op::MaskOr).and_then(|_| self.equivalence(a, b)) {
            return same;
        }
        if a == b { a } else { self.put(op, sorted(a, b)) }
    }

    /// `a` or `b`, if one is the conjunction of two masks, and the other that of their opposites.
    fn equivalence(&mut self, a: Id, b: Id) -> Option<Id> {
        let parts = |id: Id| Some(self.node(id)).filter(|n| n.op == Op::MaskAnd).map(|n| n.args);
        let ([m, n, _], [x, y, _]) = (parts(a)?, parts(b)?);
        let opposite =
            |a: Id, b: Id| [(a, b), (b, a)].iter().any(|(a, b)| self.argument_of(*a, Op::MaskNot) == Some(*b));
        if !(opposite(m, x) && opposite(n, y) || opposite(m, y) && opposite(n, x)) {
            return None;
        }
        let (m, not_m) = self.without_not(m);
        let (n, not_n) = self.without_not(n);
        let differ = self.put(Op::MaskDiffer, sorted(m, n));
        Some(if not_m == not_n { self.not(differ) } else { differ })
    }

    /// The mask without its negation, and whether there was one.
    fn without_not(&self, mask: Id) -> (Id, bool) {
        self.argument_of(mask, Op::MaskNot).map_or((mask, false), |inner| (inner, true))
    }

    pub fn select(&mut self, mask: Id, a: Id, b: Id) -> Id {
        if let Some(x) = self.known(mask) {
            return if x { a } else { b };
        }
        if let Some(inner) = self.argument_of(mask, Op::MaskNot) {
            return self.select(inner, b, a);
        }
        let same = |id: Id| Some(self.node(id)).filter(|n| n.op == Op::Select && n.args[0] == mask);
        let a = same(a).map_or(a, |n| n.args[1]);
        let b = same(b).map_or(b, |n| n.args[2]);
        if a == b { a } else { self.put(Op::Select, [mask, a, b]) }
    }

    /// 2ˣ of an integral x within the range of exponents. Adding a number whose last mantissa bit counts ones leaves
    /// x + bias in the lowest bits; from there it is shifted to the exponent.
    pub fn exp2_integral<T: Float>(&mut self, a: Id) -> Id {
        if let Some(x) = self.value::<T>(a) {
            return self.constant(x.exp2_integral());
        }
        let precision = T::PRECISION;
        let magic = 1.5 * 2_f64.powi(i32::from(precision.mantissa())) + precision.bias() as f64;
        let magic = self.constant(T::from_f64(magic));
        let sum = self.add::<T>(a, magic);
        self.put(Op::ShiftLeft, [sum, u32::from(precision.mantissa()), 0])
    }

    /// Mantissa in [√½, √2) and exponent of a positive normal number; the bits of √½ subtracted, the exponent field rolls
    /// over exactly at √½ 2ᵏ. The exponent becomes a number as the last mantissa bits of one whose last bit counts ones.
    pub fn split_exponent<T: Float>(&mut self, a: Id) -> (Id, Id) {
        if let Some(x) = self.value::<T>(a) {
            let (mantissa, exponent) = x.split_exponent();
            return (self.constant(mantissa), self.constant(exponent));
        }
        let (shift, bias) = (u32::from(T::PRECISION.mantissa()), T::PRECISION.bias());
        let root = T::from_f64(std::f64::consts::FRAC_1_SQRT_2).bits();
        let field = T::PRECISION.ones() & (T::PRECISION.ones() << shift);
        let (root_bits, field) = (self.bits(root), self.bits(field));
        let shifted = self.put(Op::IntegerSub, [a, root_bits, 0]);
        let exponent = self.put(Op::BitAnd, [shifted, field, 0]);
        let mantissa = self.put(Op::IntegerSub, [a, exponent, 0]);

        let biased_root = self.bits(root.wrapping_sub(bias << shift) & T::PRECISION.ones());
        let one_ulp = 2_f64.powi(shift as i32);
        let (magic, offset) = (T::from_f64(one_ulp), T::from_f64(one_ulp + bias as f64));
        let (magic, offset) = (self.constant(magic), self.constant(offset));
        let positive = self.put(Op::IntegerSub, [a, biased_root, 0]);
        let field = self.put(Op::ShiftRight, [positive, shift, 0]);
        let number = self.put(Op::BitOr, [field, magic, 0]);
        (mantissa, self.sub::<T>(number, offset))
    }
}

/// 1 / x if x is a power of two and the inverse a normal number: dividing is then multiplying.
fn exact_inverse<T: Float>(x: T) -> Option<T> {
    let mantissa = (1_u64 << T::PRECISION.mantissa()) - 1;
    let normal = |x: T| x.bits() & mantissa == 0 && x != T::default() && x < T::from_f64(T::MAX);
    let inverse = T::from_f64(1.0) / x;
    (normal(x) && normal(inverse)).then_some(inverse)
}

/// x y if it is exact: its error, far from the smallest numbers, is zero.
fn exact_product<T: Float>(x: T, y: T) -> Option<T> {
    let product = x * y;
    let safe = product.abs() > T::from_f64(1e-20) && product.abs() < T::from_f64(T::MAX);
    (product == T::default() && (x == product || y == product) || safe && x.mul_add(y, -product) == T::default())
        .then_some(product)
}
