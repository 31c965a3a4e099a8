//! Opcodes of operations for every instruction set and precision.

use iced_x86::Code;

use crate::float::Precision;
use crate::graph::Op;
use crate::isa::InstructionSet;
use crate::machine::Form;

/// Opcodes for AVX2 single and double, AVX-512 single and double.
type Row = [Code; 4];

fn choose(row: Row, isa: InstructionSet, precision: Precision) -> Code {
    row[2 * usize::from(isa == InstructionSet::Avx512) + usize::from(precision == Precision::Double)]
}

/// The opcode of an operation; of leaves, the one that brings them into a register.
pub(super) fn code(op: Op, isa: InstructionSet, precision: Precision) -> Code {
    use Code::*;
    #[rustfmt::skip]
    let row = match op {
        Op::Add => [VEX_Vaddps_ymm_ymm_ymmm256, VEX_Vaddpd_ymm_ymm_ymmm256, EVEX_Vaddps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vaddpd_zmm_k1z_zmm_zmmm512b64_er],
        Op::Sub => [VEX_Vsubps_ymm_ymm_ymmm256, VEX_Vsubpd_ymm_ymm_ymmm256, EVEX_Vsubps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vsubpd_zmm_k1z_zmm_zmmm512b64_er],
        Op::Mul => [VEX_Vmulps_ymm_ymm_ymmm256, VEX_Vmulpd_ymm_ymm_ymmm256, EVEX_Vmulps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vmulpd_zmm_k1z_zmm_zmmm512b64_er],
        Op::Div => [VEX_Vdivps_ymm_ymm_ymmm256, VEX_Vdivpd_ymm_ymm_ymmm256, EVEX_Vdivps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vdivpd_zmm_k1z_zmm_zmmm512b64_er],
        Op::Min => [VEX_Vminps_ymm_ymm_ymmm256, VEX_Vminpd_ymm_ymm_ymmm256, EVEX_Vminps_zmm_k1z_zmm_zmmm512b32_sae, EVEX_Vminpd_zmm_k1z_zmm_zmmm512b64_sae],
        Op::Max => [VEX_Vmaxps_ymm_ymm_ymmm256, VEX_Vmaxpd_ymm_ymm_ymmm256, EVEX_Vmaxps_zmm_k1z_zmm_zmmm512b32_sae, EVEX_Vmaxpd_zmm_k1z_zmm_zmmm512b64_sae],
        Op::BitAnd => [VEX_Vandps_ymm_ymm_ymmm256, VEX_Vandpd_ymm_ymm_ymmm256, EVEX_Vandps_zmm_k1z_zmm_zmmm512b32, EVEX_Vandpd_zmm_k1z_zmm_zmmm512b64],
        Op::BitOr => [VEX_Vorps_ymm_ymm_ymmm256, VEX_Vorpd_ymm_ymm_ymmm256, EVEX_Vorps_zmm_k1z_zmm_zmmm512b32, EVEX_Vorpd_zmm_k1z_zmm_zmmm512b64],
        Op::BitXor => [VEX_Vxorps_ymm_ymm_ymmm256, VEX_Vxorpd_ymm_ymm_ymmm256, EVEX_Vxorps_zmm_k1z_zmm_zmmm512b32, EVEX_Vxorpd_zmm_k1z_zmm_zmmm512b64],
        Op::IntegerSub => [VEX_Vpsubd_ymm_ymm_ymmm256, VEX_Vpsubq_ymm_ymm_ymmm256, EVEX_Vpsubd_zmm_k1z_zmm_zmmm512b32, EVEX_Vpsubq_zmm_k1z_zmm_zmmm512b64],
        Op::Sqrt => [VEX_Vsqrtps_ymm_ymmm256, VEX_Vsqrtpd_ymm_ymmm256, EVEX_Vsqrtps_zmm_k1z_zmmm512b32_er, EVEX_Vsqrtpd_zmm_k1z_zmmm512b64_er],
        Op::Round => [VEX_Vroundps_ymm_ymmm256_imm8, VEX_Vroundpd_ymm_ymmm256_imm8, EVEX_Vrndscaleps_zmm_k1z_zmmm512b32_imm8_sae, EVEX_Vrndscalepd_zmm_k1z_zmmm512b64_imm8_sae],
        Op::ShiftLeft => [VEX_Vpslld_ymm_ymm_imm8, VEX_Vpsllq_ymm_ymm_imm8, EVEX_Vpslld_zmm_k1z_zmmm512b32_imm8, EVEX_Vpsllq_zmm_k1z_zmmm512b64_imm8],
        Op::ShiftRight => [VEX_Vpsrld_ymm_ymm_imm8, VEX_Vpsrlq_ymm_ymm_imm8, EVEX_Vpsrld_zmm_k1z_zmmm512b32_imm8, EVEX_Vpsrlq_zmm_k1z_zmmm512b64_imm8],
        Op::Select => [VEX_Vblendvps_ymm_ymm_ymmm256_ymm, VEX_Vblendvpd_ymm_ymm_ymmm256_ymm, EVEX_Vblendmps_zmm_k1z_zmm_zmmm512b32, EVEX_Vblendmpd_zmm_k1z_zmm_zmmm512b64],
        Op::Less | Op::LessEqual | Op::Equal | Op::NotLess | Op::NotLessEqual | Op::NotEqual => [VEX_Vcmpps_ymm_ymm_ymmm256_imm8, VEX_Vcmppd_ymm_ymm_ymmm256_imm8, EVEX_Vcmpps_kr_k1_zmm_zmmm512b32_imm8_sae, EVEX_Vcmppd_kr_k1_zmm_zmmm512b64_imm8_sae],
        Op::Uniform => [VEX_Vbroadcastss_ymm_m32, VEX_Vbroadcastsd_ymm_m64, EVEX_Vbroadcastss_zmm_k1z_xmmm32, EVEX_Vbroadcastsd_zmm_k1z_xmmm64],
        Op::MaskAnd => [INVALID, INVALID, VEX_Kandw_kr_kr_kr, VEX_Kandb_kr_kr_kr],
        Op::MaskOr => [INVALID, INVALID, VEX_Korw_kr_kr_kr, VEX_Korb_kr_kr_kr],
        Op::MaskDiffer => [INVALID, INVALID, VEX_Kxorw_kr_kr_kr, VEX_Kxorb_kr_kr_kr],
        Op::MaskSame => [INVALID, INVALID, VEX_Kxnorw_kr_kr_kr, VEX_Kxnorb_kr_kr_kr],
        Op::MaskNot => [INVALID, INVALID, VEX_Knotw_kr_kr, VEX_Knotb_kr_kr],
        Op::MaskInput => [VEX_Vpcmpeqd_ymm_ymm_ymmm256, VEX_Vpcmpeqq_ymm_ymm_ymmm256, VEX_Kmovw_kr_km16, VEX_Kmovb_kr_km8],
        _ => [INVALID; 4],
    };
    choose(row, isa, precision)
}

/// The opcode of a fused operation.
pub(super) fn fused(op: Op, form: Form, isa: InstructionSet, precision: Precision) -> Code {
    use Code::*;
    #[rustfmt::skip]
    let row = match (op, form) {
        (Op::MulAdd, Form::F132) => [VEX_Vfmadd132ps_ymm_ymm_ymmm256, VEX_Vfmadd132pd_ymm_ymm_ymmm256, EVEX_Vfmadd132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd132pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::MulAdd, Form::F213) => [VEX_Vfmadd213ps_ymm_ymm_ymmm256, VEX_Vfmadd213pd_ymm_ymm_ymmm256, EVEX_Vfmadd213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd213pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::MulAdd, Form::F231) => [VEX_Vfmadd231ps_ymm_ymm_ymmm256, VEX_Vfmadd231pd_ymm_ymm_ymmm256, EVEX_Vfmadd231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmadd231pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::NegMulAdd, Form::F132) => [VEX_Vfnmadd132ps_ymm_ymm_ymmm256, VEX_Vfnmadd132pd_ymm_ymm_ymmm256, EVEX_Vfnmadd132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd132pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::NegMulAdd, Form::F213) => [VEX_Vfnmadd213ps_ymm_ymm_ymmm256, VEX_Vfnmadd213pd_ymm_ymm_ymmm256, EVEX_Vfnmadd213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd213pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::NegMulAdd, Form::F231) => [VEX_Vfnmadd231ps_ymm_ymm_ymmm256, VEX_Vfnmadd231pd_ymm_ymm_ymmm256, EVEX_Vfnmadd231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmadd231pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::MulSub, Form::F132) => [VEX_Vfmsub132ps_ymm_ymm_ymmm256, VEX_Vfmsub132pd_ymm_ymm_ymmm256, EVEX_Vfmsub132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub132pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::MulSub, Form::F213) => [VEX_Vfmsub213ps_ymm_ymm_ymmm256, VEX_Vfmsub213pd_ymm_ymm_ymmm256, EVEX_Vfmsub213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub213pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::MulSub, Form::F231) => [VEX_Vfmsub231ps_ymm_ymm_ymmm256, VEX_Vfmsub231pd_ymm_ymm_ymmm256, EVEX_Vfmsub231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfmsub231pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::NegMulSub, Form::F132) => [VEX_Vfnmsub132ps_ymm_ymm_ymmm256, VEX_Vfnmsub132pd_ymm_ymm_ymmm256, EVEX_Vfnmsub132ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub132pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::NegMulSub, Form::F213) => [VEX_Vfnmsub213ps_ymm_ymm_ymmm256, VEX_Vfnmsub213pd_ymm_ymm_ymmm256, EVEX_Vfnmsub213ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub213pd_zmm_k1z_zmm_zmmm512b64_er],
        (Op::NegMulSub, Form::F231) => [VEX_Vfnmsub231ps_ymm_ymm_ymmm256, VEX_Vfnmsub231pd_ymm_ymm_ymmm256, EVEX_Vfnmsub231ps_zmm_k1z_zmm_zmmm512b32_er, EVEX_Vfnmsub231pd_zmm_k1z_zmm_zmmm512b64_er],
        _ => [INVALID; 4],
    };
    choose(row, isa, precision)
}

/// The predicate of a comparison, of swapped operands if asked for: quiet, and false for NaN unless negated.
pub(super) fn predicate(op: Op, swapped: bool) -> u32 {
    match (op, swapped) {
        (Op::Less, false) => 0x11,
        (Op::LessEqual, false) => 0x12,
        (Op::NotLess, false) => 0x15,
        (Op::NotLessEqual, false) => 0x16,
        (Op::Less, true) => 0x1e,
        (Op::LessEqual, true) => 0x1d,
        (Op::NotLess, true) => 0x1a,
        (Op::NotLessEqual, true) => 0x19,
        (Op::NotEqual, _) => 0x04,
        _ => 0x00,
    }
}
