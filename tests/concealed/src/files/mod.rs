//! Files: tables of rows, the robot's dimensions, folders of cases.

pub mod commands;
pub mod folder;
pub mod table;
