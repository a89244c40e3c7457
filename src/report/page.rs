//! The page every report is printed on: one file that opens without a network, on a phone, in the dark and on paper.

use serde::Serialize;

const STYLE: &str = include_str!("assets/report.css");
const SCRIPT: &str = include_str!("assets/report.js");
const UPLOT_STYLE: &str = include_str!("assets/uplot/uPlot.min.css");
const UPLOT_SCRIPT: &str = include_str!("assets/uplot/uPlot.iife.min.js");
const UPLOT_LICENCE: &str = include_str!("assets/uplot/LICENSE");

/// Nothing may be loaded from anywhere: what is on the page is all there is.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:";

/// Text with the characters that mean something to HTML written as entities; safe between tags and in quoted attributes.
pub fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            c => safe.push(c),
        }
    }
    safe
}

/// Text whose `names` in backticks are set as code.
pub fn prose(text: &str) -> String {
    let parts: Vec<String> = escape(text).split('`').map(str::to_owned).collect();
    // An even number of backticks leaves an odd number of parts; anything else is not ours to pair.
    if parts.len().is_multiple_of(2) {
        return escape(text);
    }
    parts.iter().enumerate().map(|(i, part)| if i % 2 == 1 { format!("<code>{part}</code>") } else { part.clone() }).collect()
}

/// A value as a JSON script element. `<` is written as an escape, so that no text can end the element.
pub fn embed_json(value: &impl Serialize) -> String {
    // Plot data are numbers, texts and lists, which always have a JSON form.
    let json = serde_json::to_string(value).unwrap_or_else(|_| "null".to_owned());
    format!("<script type=\"application/json\">{}</script>", json.replace('<', "\\u003c"))
}

/// A page under construction. Bodies given to it are HTML already; titles are text.
#[derive(Debug)]
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    /// A page with a heading and a line below it.
    pub fn new(title: &str, subtitle: &str) -> Self {
        let (title, subtitle) = (escape(title), escape(subtitle));
        let body = format!(
            "<header><h1>{title}</h1><p class=\"subtitle\">{subtitle}</p></header>\n\
             <noscript><p class=\"note\">Plots are drawn by a script in this file, which this browser does not run. \
             All numbers and tables are here without it.</p></noscript>\n"
        );
        Self { title, body }
    }

    /// Adds a part without a heading.
    pub fn push(&mut self, html: &str) {
        self.body.push_str(html);
        self.body.push('\n');
    }

    /// Adds a part with a heading, under an anchor; nothing if it is empty.
    pub fn section(&mut self, anchor: &str, heading: &str, html: &str) {
        if !html.is_empty() {
            self.push(&format!("<section id=\"{}\"><h2>{}</h2>\n{html}</section>", escape(anchor), escape(heading)));
        }
    }

    /// The finished file; `colophon` is the last line of text.
    pub fn finish(self, colophon: &str) -> String {
        let Self { title, body } = self;
        // The library's own first line is a comment with its address; the licence that must travel with it says more.
        let uplot = UPLOT_SCRIPT.split_once("*/").map_or(UPLOT_SCRIPT, |(_, code)| code);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n<link rel=\"icon\" href=\"data:,\">\n\
             <style>\n{UPLOT_STYLE}\n{STYLE}</style>\n</head>\n<body>\n<main>\n{body}\
             <footer>{colophon}</footer>\n</main>\n\
             <script>\n/* uPlot 1.6.32\n{UPLOT_LICENCE}\n*/{uplot}</script>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n",
            colophon = escape(colophon),
        )
    }
}

/// A list of texts, as things a reader should know; nothing if there are none.
pub fn notes(class: &str, heading: &str, texts: &[String]) -> String {
    if texts.is_empty() {
        return String::new();
    }
    let items: String = texts.iter().map(|t| format!("<li>{}</li>", prose(t))).collect();
    format!("<aside class=\"{}\"><h3>{}</h3><ul>{items}</ul></aside>\n", escape(class), escape(heading))
}

/// `a, b and c`.
pub fn enumerate(parts: &[String]) -> String {
    match parts {
        [] => String::new(),
        [one] => one.clone(),
        [head @ .., last] => format!("{} and {last}", head.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        assert_eq!(escape("<script>alert('a & \"b\"')</script>"), "&lt;script&gt;alert(&#39;a &amp; &quot;b&quot;&#39;)&lt;/script&gt;");
        assert_eq!(prose("no `a<b` in `c`"), "no <code>a&lt;b</code> in <code>c</code>");
        assert_eq!(prose("it`s"), "it`s");
        let json = embed_json(&"</script><!-- <script>");
        assert_eq!(json.matches("</script>").count(), 1);
        assert!(json.ends_with("</script>") && !json.contains("<!--"));
    }

    #[test]
    fn a_page_loads_nothing() {
        let mut page = Page::new("a <b>", "c & d");
        page.section("empty", "Empty", "");
        page.section("one", "One & only", "<p>text</p>");
        let html = page.finish("wheelwright");
        assert!(!html.contains("http://") && !html.contains("https://") && !html.contains("@import") && !html.contains("src=\""));
        assert!(html.contains("<title>a &lt;b&gt;</title>") && html.contains("One &amp; only") && !html.contains("Empty"));
        assert!(html.contains("Permission is hereby granted"), "the licence of the plot library travels with it");
    }
}
