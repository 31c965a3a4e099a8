//! Why there may be no code.

/// Why a program could not be compiled. The caller runs its kernels over another lane instead.
#[derive(Debug, thiserror::Error)]
pub enum CompileError {
    /// Code is generated for x86-64 with the System V calling convention only.
    #[error("no code generation for this platform: it needs x86-64 and not Windows")]
    Platform,
    /// The processor, or the system, lacks the instruction set.
    #[error("this processor does not have {0}")]
    Processor(&'static str),
    /// The system refused memory for code.
    #[error("no memory for code: {0}")]
    Memory(#[from] std::io::Error),
    /// The encoder refused an instruction.
    #[error("cannot encode: {0}")]
    Encoding(String),
    /// A field or the fragment is beyond the reach of 32-bit displacements.
    #[error("the fragment is too large: {0}")]
    TooLarge(&'static str),
}
