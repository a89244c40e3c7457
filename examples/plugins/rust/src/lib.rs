//! A robot, a model and an effect for Wheelwright in a shared library of their own.
//!
//! Everything but the last line is written as for a built-in. Build and use:
//!
//! ```text
//! cargo build --release -p wheelwright-example-plugin
//! ```
//! ```toml
//! [[plugin]]
//! path = "target/release/libwheelwright_example_plugin.so"
//!
//! [robot]
//! type = "second-order-base"
//! bandwidth = 12.0
//!
//! [model]
//! type = "lag"
//! ```

pub mod effect;
pub mod model;
pub mod robot;

wheelwright_plugin::export! { robots: ["second-order-base"], models: ["lag"], effects: ["bus_period"] }
