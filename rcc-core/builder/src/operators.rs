//! Operators: `+ - * /` and unary `-` for numbers, `& | !` for conditions. Each adds a primitive with a generated id.
//! Used by applications, never on a real-time thread.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use crate::{Bool, In, Out, Real};

macro_rules! operators {
    ($($operator:ident::$function:ident of $ty:ident is $primitive:ident($a:literal, $b:literal), $name:literal;)*) => {
        $(impl<'n, B: Into<In<'n, $ty>>> $operator<B> for Out<'n, $ty> {
            type Output = Out<'n, $ty>;

            fn $function(self, other: B) -> Out<'n, $ty> {
                let node = self.net.node(stringify!($primitive), &self.net.id($name));
                node.input($a, In::from(self).source());
                node.input($b, other.into().source());
                node.output("out", false)
            }
        })*
    };
}

operators! {
    Add::add of Real is Add("a", "b"), "sum";
    Sub::sub of Real is Subtract("a", "b"), "difference";
    Mul::mul of Real is Multiply("a", "b"), "product";
    Div::div of Real is Divide("a", "b"), "quotient";
    BitAnd::bitand of Bool is And("a", "b"), "both";
    BitOr::bitor of Bool is Or("a", "b"), "either";
}

impl<'n> Neg for Out<'n, Real> {
    type Output = Out<'n, Real>;

    fn neg(self) -> Out<'n, Real> {
        let node = self.net.node("Negate", &self.net.id("minus"));
        node.input("in", In::from(self).source());
        node.output("out", false)
    }
}

impl<'n> Not for Out<'n, Bool> {
    type Output = Out<'n, Bool>;

    fn not(self) -> Out<'n, Bool> {
        let node = self.net.node("Not", &self.net.id("not"));
        node.input("in", In::from(self).source());
        node.output("out", false)
    }
}
