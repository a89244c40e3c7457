//! stub
/// stub
pub fn study_page(_: &crate::study::Study, _: &crate::study::Findings) -> String { String::new() }
