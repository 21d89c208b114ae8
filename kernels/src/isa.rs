//! Instruction sets, chosen at run time: a plain `cargo build --release` is fast on every machine.
//!
//! A kernel is a struct of its arguments that implements [`Kernel`]; [`Isa::run`] enters a function compiled for the
//! instruction set and instantiates the kernel there with the set's lane types. Everything below that call is
//! `#[inline(always)]`, so all of it is compiled with the features (measured: as fast as `target-cpu=native`). That
//! function itself is never inlined: a stage shows under its own name in a profile, and is compiled once.

use crate::lanes::sealed::Sealed;
use crate::lanes::{Portable, Real};

/// Work that can be instantiated for any instruction set.
pub trait Kernel {
    /// What it returns.
    type Output;
    /// Does the work. Implementations are `#[inline(always)]`.
    fn run<I: Isa>(self, isa: I) -> Self::Output;
}

/// The word of whoever makes a kernel that what the kernel reads unchecked is there: each such kernel says what it is.
#[derive(Clone, Copy, Debug)]
pub struct Promise(());

impl Promise {
    /// # Safety
    /// What the documentation of the kernel demands, on which this is put, holds.
    #[inline(always)]
    pub const unsafe fn new() -> Self {
        Promise(())
    }
}

/// An instruction set: its lane types and the way into functions compiled for it.
///
/// A value of such a type is the proof that the machine has the set: only [`Level::run`] makes one, after asking the
/// CPU.
pub trait Isa: Sealed + Copy + Send + Sync + 'static {
    /// Widest lanes: the batch kernels.
    type Wide: Real;
    /// Exactly 8 lanes: one ray against 8 boxes.
    type Eight: Real;
    /// Exactly 4 lanes: one ray against 4 triangles.
    type Four: Real;
    /// One lane, with fused multiply-add exactly if [`Isa::Wide`] has it, so that engines agree to the bit.
    type One: Real<Mask = bool, Uint = core::num::Wrapping<u32>>;
    /// Name for reports.
    const NAME: &'static str;
    /// Are kernels compiled for each set of features? Where not, one for all features serves (see
    /// [`crate::shade::Features::General`]): it is for machines that wait for other things, and builds stay short.
    const SPECIALISED: bool = true;
    /// Runs a kernel compiled for this set.
    fn run<K: Kernel>(self, kernel: K) -> K::Output;
}

/// An instruction set that this machine has, and this program kernels for: no machine without it has such a value. They
/// have no order.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Level(Set);

/// The instruction sets there are.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Set {
    /// What every machine of the architecture has (SSE2, NEON).
    Baseline,
    /// AVX2 and FMA, one path at a time: see [`Level::one_lane`].
    OneLane,
    /// AVX2 and FMA.
    Avx2,
    /// AVX-512 F, DQ, VL, BW, CD.
    Avx512,
}

impl Set {
    fn is_available(self) -> bool {
        self.is_compiled() && self.is_of_machine()
    }

    /// `--cfg wavepath_only="avx512"` (or `"avx2"`) compiles kernels for that set and the baseline alone: for short
    /// builds while working on them.
    const fn is_compiled(self) -> bool {
        match self {
            Set::Baseline => true,
            Set::OneLane => !cfg!(any(wavepath_only = "avx512", wavepath_only = "avx2")),
            Set::Avx2 => !cfg!(wavepath_only = "avx512"),
            Set::Avx512 => !cfg!(wavepath_only = "avx2"),
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn is_of_machine(self) -> bool {
        let avx2 = || {
            std::is_x86_feature_detected!("avx2")
                && std::is_x86_feature_detected!("fma")
                && std::is_x86_feature_detected!("bmi1")
                && std::is_x86_feature_detected!("bmi2")
                && std::is_x86_feature_detected!("lzcnt")
                && std::is_x86_feature_detected!("popcnt")
        };
        match self {
            Set::Baseline => true,
            Set::OneLane | Set::Avx2 => avx2(),
            Set::Avx512 => {
                avx2()
                    && std::is_x86_feature_detected!("avx512f")
                    && std::is_x86_feature_detected!("avx512dq")
                    && std::is_x86_feature_detected!("avx512vl")
                    && std::is_x86_feature_detected!("avx512bw")
                    && std::is_x86_feature_detected!("avx512cd")
            }
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn is_of_machine(self) -> bool {
        self == Set::Baseline
    }
}

impl core::fmt::Debug for Level {
    fn fmt(&self, f: &mut core::fmt::Formatter) -> core::fmt::Result {
        f.write_str(self.name())
    }
}

impl Level {
    /// What every machine of the architecture has (SSE2, NEON).
    pub const BASELINE: Level = Level(Set::Baseline);

    /// The best set of this machine.
    pub fn detect() -> Level {
        Level::available().next().unwrap_or(Level::BASELINE)
    }

    /// All sets that this machine has, the best first. [`Level::one_lane`] is not among them.
    pub fn available() -> impl Iterator<Item = Level> {
        [Set::Avx512, Set::Avx2, Set::Baseline].into_iter().filter(|set| set.is_available()).map(Level)
    }

    /// AVX2 and FMA for one ray against many boxes and triangles, but one path at a time in all else, where the machine
    /// has them: what the width of the batch kernels is held against.
    pub fn one_lane() -> Option<Level> {
        Set::OneLane.is_available().then_some(Level(Set::OneLane))
    }

    /// Name for reports.
    pub fn name(self) -> &'static str {
        match self.0 {
            Set::Baseline => Baseline::NAME,
            #[cfg(target_arch = "x86_64")]
            Set::OneLane => OneLane::NAME,
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => Avx2::NAME,
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => Avx512::NAME,
            #[cfg(not(target_arch = "x86_64"))]
            _ => Baseline::NAME,
        }
    }

    /// Runs a kernel on this set.
    #[inline]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self.0 {
            Set::Baseline => Baseline.run(kernel),
            #[cfg(all(target_arch = "x86_64", not(any(wavepath_only = "avx512", wavepath_only = "avx2"))))]
            Set::OneLane => OneLane(()).run(kernel),
            #[cfg(all(target_arch = "x86_64", not(wavepath_only = "avx512")))]
            Set::Avx2 => Avx2(()).run(kernel),
            #[cfg(all(target_arch = "x86_64", not(wavepath_only = "avx2")))]
            Set::Avx512 => Avx512(()).run(kernel),
            #[allow(unreachable_patterns, reason = "nothing is left where all are compiled")]
            _ => unreachable!("no such value is made"),
        }
    }
}

/// What every machine of the architecture has.
#[derive(Clone, Copy, Debug)]
pub struct Baseline;

impl Sealed for Baseline {}

impl Isa for Baseline {
    type Wide = Portable<4>;
    type Eight = Portable<8>;
    type Four = Portable<4>;
    type One = f32;
    const NAME: &'static str = "baseline";
    const SPECIALISED: bool = false;
    #[inline(never)]
    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run(self)
    }
}

#[cfg(target_arch = "x86_64")]
use x86::{Avx2, Avx512, OneLane};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Isa, Kernel, Sealed};
    use crate::lanes::{F32x4, F32x8, F32x16, FusedF32};

    /// AVX2 and FMA.
    #[derive(Clone, Copy, Debug)]
    pub struct Avx2(pub(super) ());

    impl Sealed for Avx2 {}

    impl Isa for Avx2 {
        type Wide = F32x8;
        type Eight = F32x8;
        type Four = F32x4;
        type One = FusedF32;
        const NAME: &'static str = "avx2";
        #[inline(always)]
        fn run<K: Kernel>(self, kernel: K) -> K::Output {
            #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
            #[inline(never)]
            fn compiled<K: Kernel>(isa: Avx2, kernel: K) -> K::Output {
                kernel.run(isa)
            }
            // SAFETY: `self` exists only where the machine has the features.
            unsafe { compiled(self, kernel) }
        }
    }

    /// AVX2 and FMA, one path at a time.
    #[derive(Clone, Copy, Debug)]
    pub struct OneLane(pub(super) ());

    impl Sealed for OneLane {}

    impl Isa for OneLane {
        type Wide = FusedF32;
        type Eight = F32x8;
        type Four = F32x4;
        type One = FusedF32;
        const NAME: &'static str = "avx2, one lane";
        #[inline(always)]
        fn run<K: Kernel>(self, kernel: K) -> K::Output {
            #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
            #[inline(never)]
            fn compiled<K: Kernel>(isa: OneLane, kernel: K) -> K::Output {
                kernel.run(isa)
            }
            // SAFETY: `self` exists only where the machine has the features.
            unsafe { compiled(self, kernel) }
        }
    }

    /// AVX-512 F, DQ, VL, BW, CD.
    #[derive(Clone, Copy, Debug)]
    pub struct Avx512(pub(super) ());

    impl Sealed for Avx512 {}

    impl Isa for Avx512 {
        type Wide = F32x16;
        type Eight = F32x8;
        type Four = F32x4;
        type One = FusedF32;
        const NAME: &'static str = "avx512";
        #[inline(always)]
        fn run<K: Kernel>(self, kernel: K) -> K::Output {
            #[target_feature(
                enable = "avx512f,avx512dq,avx512vl,avx512bw,avx512cd,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
            )]
            #[inline(never)]
            fn compiled<K: Kernel>(isa: Avx512, kernel: K) -> K::Output {
                kernel.run(isa)
            }
            // SAFETY: `self` exists only where the machine has the features.
            unsafe { compiled(self, kernel) }
        }
    }
}
