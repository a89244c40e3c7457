//! Signal conditioning, per stretch.
