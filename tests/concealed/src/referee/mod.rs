//! The referee's side: how visible is what was hidden, where does it act, how well could anything predict.

pub mod detect;
pub mod key;
pub mod lumped;
