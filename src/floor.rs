//! The instruction set that this program was built for, checked before anything uses it: an older processor gets a sentence
//! instead of a crash. The standard library's own test is no help, it takes what the build assumes for granted.

use std::io::Write;
use std::process::ExitCode;

/// What the build needs and this processor lacks.
#[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
pub fn missing() -> Option<&'static str> {
    let cpuid = raw_cpuid::CpuId::new();
    let basic = cpuid.get_feature_info();
    let extended = cpuid.get_extended_feature_info();
    let has_fma = basic.is_some_and(|f| f.has_fma() && f.has_avx());
    let has_avx2 = extended.is_some_and(|f| f.has_avx2() && f.has_bmi2());
    match (has_fma, has_avx2) {
        (true, true) => None,
        (false, _) => Some("AVX and FMA"),
        (true, false) => Some("AVX2 and BMI2"),
    }
}

/// What the build needs and this processor lacks: nothing, builds for other processors use their baseline.
#[cfg(not(all(target_arch = "x86_64", target_feature = "avx2")))]
pub fn missing() -> Option<&'static str> {
    None
}

/// Says so.
#[cold]
pub fn refuse(missing: &str) -> ExitCode {
    let _ = writeln!(
        std::io::stderr(),
        "error: this program was built for x86-64-v3 and this processor lacks {missing}; build it with \
         RUSTFLAGS=\"-C target-cpu=native\""
    );
    ExitCode::FAILURE
}
