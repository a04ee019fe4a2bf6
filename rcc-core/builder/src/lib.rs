//! Nets built by Rust programs: every primitive of the catalogue is a method of [`NetBuilder`] with typed ports, and
//! the result is the same model and text as from a file. Used by applications, never on a real-time thread.
//!
//! ```
//! use rcc_net::NetBuilder;
//!
//! let net = NetBuilder::new("example");
//! let time = net.time("time");
//! let late = net.greater("late", time.out * 2.0, "3 s");
//! net.termination("end", late.out);
//! println!("{}", net.to_yaml()?);
//! # Ok::<(), rcc_net::BuildError>(())
//! ```
//!
//! Type errors do not compile:
//!
//! ```compile_fail
//! # use rcc_net::NetBuilder;
//! let net = NetBuilder::new("example");
//! let time = net.time("time");
//! net.not("not", time.out); // a Real is not a Bool
//! ```
//!
//! ```compile_fail
//! # use rcc_net::NetBuilder;
//! let net = NetBuilder::new("example");
//! let time = net.time("time");
//! net.add("sum", time.out, true); // operands of two types
//! ```
//!
//! ```compile_fail
//! # use rcc_net::NetBuilder;
//! let net = NetBuilder::new("example");
//! net.and("and", true); // an input is missing
//! ```
//!
//! Units are checked when the net is loaded (or by `rcc-cli check`), where the units of channels are also known.

/// Runs the examples of the document as doctests.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/builder.md")]
pub struct Document;

mod builder;
mod constants;
mod fragment;
mod operators;
mod value;

pub mod primitives {
    //! One type per primitive: its outputs are fields, its optional inputs and parameters are methods. Generated from
    //! the catalogue; the methods of [`NetBuilder`](crate::NetBuilder) return these types.
    #![allow(
        clippy::too_many_arguments,
        clippy::doc_markdown,
        clippy::doc_lazy_continuation
    )]

    include!(concat!(env!("OUT_DIR"), "/primitives.rs"));
}

pub use builder::{AnyIn, BuildError, Delayed, In, NetBuilder, Node, Out};
pub use fragment::{FragmentBuilder, Instance};
pub use value::{
    AnyValue, Bool, Int, Joints, Linear, Matrix, Number, Pose, Real, Reals, Rotation, Scalar, Text,
    Twist, Type, Untyped, Value, Vector3, Wrench, literal, null, pose, rotation,
};
