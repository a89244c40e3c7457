//! The page of a score: rates with intervals, by what the key tells, and the confusion matrix.

use std::collections::BTreeSet;
use std::fmt::Write;

use crate::report::number;
use crate::report::page::{Page, escape};
use crate::report::table::Table;
use crate::score::{Header, RATES, Rate, Score, Summary};

/// The page as text.
pub fn html(score: &Score<'_>, title: &str, header: &Header, seal: Option<bool>, command: &str) -> String {
    let without = if header.without.is_empty() { String::new() } else { format!(", without {}", header.without.join(", ")) };
    let sealed = if seal == Some(true) { "the key was sealed before the answers" } else { "no seal" };
    let version = header.version.as_deref().unwrap_or("of an unknown version");
    let mut page = Page::new(title, &format!("{} cases, answered by wheelwright {version}{without}; {sealed}", score.cases.len()));
    let classes = score.by_class();
    page.push(&tiles(&classes));
    page.section("classes", "Rates", &format!("{}{}", rates(&classes), figures(&classes)));
    page.section("meaning", "What the rates are", &meanings());
    for (name, rows) in score.by() {
        page.section(name, &format!("By {}", name.replace('_', " ")), &format!("{}{}", rates(&rows), figures(&rows)));
    }
    page.section("confusion", "Hidden and said", &confusion(score));
    page.section("repeat", "To repeat this", &format!("<pre>{}</pre>", escape(command)));
    page.finish(&format!("Made by wheelwright {}.", env!("CARGO_PKG_VERSION")))
}

fn tiles(classes: &[Summary]) -> String {
    let mut html = String::from("<div class=\"headline\"><div class=\"tiles\">");
    for class in classes {
        let (name, what) = match class.name.as_str() {
            "none" => ("false_alarm", "false alarms"),
            "outside" | "removed" => ("confidently_wrong", "confidently wrong"),
            _ => ("exact_or_equivalent", "exact or equivalent"),
        };
        let rate = class.rate(name);
        let Some((share, (low, high))) = rate.share().zip(rate.wilson()) else { continue };
        // Writing to a String cannot fail.
        let _ = write!(
            html,
            "<div class=\"tile\"><span class=\"what\">{}: {what}</span><span class=\"big\">{}</span><span class=\"small\">{} of {} · 95 % {} to {}</span></div>",
            escape(&class.name.replace('_', " ")),
            number::percent(100.0 * share),
            rate.hits,
            rate.of,
            number::fixed(100.0 * low, 1),
            number::fixed(100.0 * high, 1)
        );
    }
    html.push_str("</div></div>\n");
    html
}

/// A row each, a column a rate that any of them has.
fn rates(rows: &[Summary]) -> String {
    let used: Vec<usize> = (0..RATES.len()).filter(|&i| rows.iter().any(|r| r.rates[i].of > 0)).collect();
    let names: Vec<String> = used.iter().map(|&i| format!("#{}", RATES[i].0.replace('_', " "))).collect();
    let headings: Vec<&str> = ["", "#n"].into_iter().chain(names.iter().map(String::as_str)).collect();
    let mut table = Table::new(&headings);
    for row in rows {
        let cells = used.iter().map(|&i| cell(row.rates[i]));
        table.row([escape(&row.name), row.cases.to_string()].into_iter().chain(cells).collect());
    }
    table.html()
}

fn cell(rate: Rate) -> String {
    match (rate.share(), rate.wilson()) {
        (Some(share), Some((low, high))) => format!(
            "{}<br><span class=\"note\">{}/{} · {}–{}</span>",
            number::percent(100.0 * share),
            rate.hits,
            rate.of,
            number::fixed(100.0 * low, 0),
            number::fixed(100.0 * high, 0)
        ),
        _ => number::NONE.to_owned(),
    }
}

/// What is no rate: gap closed, localisation, time of a payload, seconds.
fn figures(rows: &[Summary]) -> String {
    let mut table = Table::new(&["", "#Reported", "#Gap closed", "#F1 in time", "#F1 of regions", "#Payload time", "#Seconds"]);
    let none = || number::NONE.to_owned();
    for row in rows {
        let cells = [
            row.set_size.map_or_else(none, |n| number::fixed(n, 2)),
            row.gap_closed.map_or_else(none, |[_, median, _]| number::percent(100.0 * median)),
            row.times.f1().map_or_else(none, |f| number::fixed(f, 3)),
            row.regions.f1().map_or_else(none, |f| number::fixed(f, 3)),
            row.payload.map_or_else(none, |(median, _)| format!("±{} s", number::fixed(median, 2))),
            row.seconds.map_or_else(none, |(_, median)| number::fixed(median, 2)),
        ];
        if cells.iter().any(|c| c != number::NONE) {
            table.row(std::iter::once(escape(&row.name)).chain(cells).collect());
        }
    }
    table.html()
}

fn meanings() -> String {
    let item = |(name, meaning, _): &(&str, &str, _)| format!("<li>{}: {}</li>", name.replace('_', " "), escape(meaning));
    let items: String = RATES.iter().map(item).collect();
    format!(
        "<ul class=\"evidence\">{items}</ul><p class=\"note\">Small numbers: cases counted, and Wilson's 95 % interval in percent.</p>\n"
    )
}

/// A row a truth, a column a thing said.
fn confusion(score: &Score<'_>) -> String {
    let matrix = score.confusion();
    let said: BTreeSet<&str> = matrix.values().flat_map(|row| row.keys().copied()).collect();
    // Columns that many rows share make a matrix; what was said once or twice reads better as words.
    let total = |name: &str| matrix.values().filter_map(|row| row.get(name)).sum::<usize>();
    let mut columns: Vec<&str> = said.into_iter().collect();
    columns.sort_by(|a, b| total(b).cmp(&total(a)).then(a.cmp(b)));
    let mut table = Table::new(&["Hidden", "#n", "Said"]);
    for (truth, row) in &matrix {
        let count: usize = row.values().sum();
        let list = columns.iter().filter_map(|name| row.get(name).map(|n| (name, n)));
        let mut list: Vec<(&&str, &usize)> = list.collect();
        list.sort_by(|a, b| b.1.cmp(a.1));
        let words: Vec<String> = list
            .iter()
            .map(|(name, n)| {
                let right = if *name == truth { "<b>" } else { "" };
                let end = if *name == truth { "</b>" } else { "" };
                format!("{right}<code>{}</code> {n}{end}", escape(name))
            })
            .collect();
        table.row(vec![format!("<code>{}</code>", escape(truth)), count.to_string(), words.join(", ")]);
    }
    table.html()
}
