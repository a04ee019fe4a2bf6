//! Writes `docs/from-the-predecessor.md` to the standard output: what becomes of each of the predecessor's types.
//! A program for people who change the table.

fn main() {
    print!("{}", rcc_directionet::document::markdown());
}
