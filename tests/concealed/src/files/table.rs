//! A recording as CSV.

use crate::firmware::Command;
use crate::sensors::Columns;
use std::fmt::Write;

/// Columns beside `t,v_ref,omega_ref,v,omega`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extra {
    /// `x,y,phi`.
    pub pose: bool,
    /// Whether `phi` is wrapped to half a turn either way.
    pub wrapped: bool,
    /// `omega_left,omega_right`.
    pub wheels: bool,
}

/// Writes rows as CSV text.
pub fn write(commands: &[Command], columns: &Columns, extra: Extra) -> String {
    let mut out = String::with_capacity(commands.len() * 80);
    out.push_str("t,v_ref,omega_ref,v,omega");
    if extra.pose {
        out.push_str(",x,y,phi");
    }
    if extra.wheels {
        out.push_str(",omega_left,omega_right");
    }
    out.push('\n');
    for (k, c) in commands.iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = write!(out, "{:.6},{:.9},{:.9},{:.7},{:.7}", c.t, c.v, c.omega, columns.v[k], columns.omega[k]);
        if extra.pose {
            let [x, y, phi] = [columns.pose[0][k], columns.pose[1][k], columns.pose[2][k]];
            let phi = if extra.wrapped { phi.sin().atan2(phi.cos()) } else { phi };
            let _ = write!(out, ",{x:.7},{y:.7},{phi:.7}");
        }
        if extra.wheels {
            let _ = write!(out, ",{:.7},{:.7}", columns.wheel[0][k], columns.wheel[1][k]);
        }
        out.push('\n');
    }
    out
}
