//! The command `wavepath`: a thin shell around the library.
fn main() {}
