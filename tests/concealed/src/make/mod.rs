//! Makes cases: a recipe says what goes in, a built robot drives, a case is written.

pub mod built;
pub mod case;
pub mod plan;
pub mod recipe;
