//! Tables that stay readable on a phone: there each row becomes a card of its own, every cell under its column's name.

use std::fmt::Write;

use crate::report::page::escape;

/// A table under construction. Headings are text, cells are HTML.
#[derive(Debug, Default)]
pub struct Table {
    headings: Vec<(String, bool)>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// Columns by heading; those whose heading starts with `#` hold numbers and are set to the right.
    pub fn new(headings: &[&str]) -> Self {
        let split = |h: &&str| h.strip_prefix('#').map_or_else(|| ((*h).to_owned(), false), |name| (name.to_owned(), true));
        Self { headings: headings.iter().map(split).collect(), rows: Vec::new() }
    }

    /// Adds a row; its first cell names it.
    pub fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    /// The table, or nothing without rows.
    pub fn html(&self) -> String {
        if self.rows.is_empty() {
            return String::new();
        }
        let class = |number: bool| if number { " class=\"number\"" } else { "" };
        let head: String =
            self.headings.iter().map(|(name, number)| format!("<th scope=\"col\"{}>{}</th>", class(*number), escape(name))).collect();
        let mut html = format!("<div class=\"table\"><table><thead><tr>{head}</tr></thead><tbody>\n");
        for row in &self.rows {
            html.push_str("<tr>");
            for (i, ((name, number), cell)) in self.headings.iter().zip(row).enumerate() {
                // Writing to a String cannot fail.
                let _ = match i {
                    0 => write!(html, "<th scope=\"row\">{cell}</th>"),
                    _ => write!(html, "<td data-label=\"{}\"{}>{cell}</td>", escape(name), class(*number)),
                };
            }
            html.push_str("</tr>\n");
        }
        html.push_str("</tbody></table></div>\n");
        html
    }
}

/// Pairs of a term and its text, as a description list; both are escaped.
pub fn facts(pairs: &[(String, String)]) -> String {
    if pairs.is_empty() {
        return String::new();
    }
    let items: String = pairs.iter().map(|(k, v)| format!("<div><dt>{}</dt><dd>{}</dd></div>", escape(k), escape(v))).collect();
    format!("<dl class=\"facts\">{items}</dl>\n")
}
