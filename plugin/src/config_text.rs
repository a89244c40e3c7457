//! Configuration as the text that crosses the boundary: one `dotted.key = value` a line, each value on its line, so that a C
//! library finds a key with a string search and everybody else with a TOML parser.

use toml::{Table, Value};
use wheelwright_core::config::{ConfigError, nearest};

/// The table as text. Parsing it as TOML gives the table back.
pub(crate) fn text(table: &Table) -> String {
    let mut text = String::new();
    for (key, value) in lines(table) {
        text.push_str(&key);
        text.push_str(" = ");
        inline(value, &mut text);
        text.push('\n');
    }
    text
}

/// Refuses keys that are not in `keys`. A key that names a table stands for everything in it.
pub(crate) fn check_keys(table: &Table, keys: &[String]) -> Result<(), ConfigError> {
    for (key, _) in lines(table) {
        let known = |k: &String| key == *k || key.strip_prefix(k.as_str()).is_some_and(|rest| rest.starts_with('.'));
        if key == "type" || keys.iter().any(known) {
            continue;
        }
        let meant = nearest(&key, keys.iter().map(String::as_str)).map(|k| format!("; did you mean `{k}`?")).unwrap_or_default();
        let expected = match keys {
            [] => "there are no keys but `type`".to_owned(),
            keys => format!("expected one of `{}`", keys.join("`, `")),
        };
        return Err(ConfigError::new(key.clone(), format!("unknown field `{key}`, {expected}{meant}")));
    }
    Ok(())
}

/// Leaves of the table by dotted key, in order.
fn lines(table: &Table) -> Vec<(String, &Value)> {
    let mut lines = Vec::new();
    for (key, value) in table {
        let key = bare_or_quoted(key);
        match value {
            Value::Table(inner) if !inner.is_empty() => {
                lines.extend(self::lines(inner).into_iter().map(|(rest, value)| (format!("{key}.{rest}"), value)));
            }
            _ => lines.push((key, value)),
        }
    }
    lines
}

fn bare_or_quoted(key: &str) -> String {
    let bare = !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare {
        return key.to_owned();
    }
    let mut quoted = String::new();
    quote(key, &mut quoted);
    quoted
}

/// A basic TOML string on one line: the `toml` crate would write a text with line breaks over several.
fn quote(text: &str, out: &mut String) {
    out.push('"');
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            c if c.is_control() => out.push_str(&format!("\\u{:04X}", u32::from(c))),
            c => out.push(c),
        }
    }
    out.push('"');
}

fn inline(value: &Value, out: &mut String) {
    match value {
        Value::String(s) => quote(s, out),
        Value::Integer(i) => out.push_str(&i.to_string()),
        Value::Float(f) if f.is_nan() => out.push_str("nan"),
        // `{:?}` writes the shortest text that reads back to the same number, with a point or an exponent.
        Value::Float(f) => out.push_str(&format!("{f:?}")),
        Value::Boolean(b) => out.push_str(&b.to_string()),
        Value::Datetime(d) => out.push_str(&d.to_string()),
        Value::Array(items) => {
            out.push('[');
            for (i, item) in items.iter().enumerate() {
                out.push_str(if i > 0 { ", " } else { "" });
                inline(item, out);
            }
            out.push(']');
        }
        Value::Table(table) => {
            out.push('{');
            for (i, (key, item)) in table.iter().enumerate() {
                out.push_str(if i > 0 { ", " } else { "" });
                out.push_str(&bare_or_quoted(key));
                out.push_str(" = ");
                inline(item, out);
            }
            out.push('}');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLE: &str = r#"
        type = "my-robot"
        port = "/dev/tty\"0\""
        note = """two
lines \u0000 ä"""
        theta = [0.1, 1e300, -0.0, inf, 3]
        on = true
        day = 2011-05-01
        empty = {}
        [limits]
        v = 1.4
        "odd.key" = 1
        [[pulses]]
        at = 1.0
        shape = { kind = "step" }
    "#;

    #[test]
    fn text_is_one_key_a_line_and_reads_back() {
        let table: Table = SAMPLE.parse().unwrap();
        let text = text(&table);
        let again: Table = text.parse().unwrap();
        assert_eq!(again, table);
        assert_eq!(text.lines().count(), 10);
        assert!(text.contains("\nlimits.v = 1.4\nlimits.\"odd.key\" = 1\n"), "{text}");
        assert!(text.contains("pulses = [{at = 1.0, shape = {kind = \"step\"}}]\n"), "{text}");
        assert!(!text.contains('\0'));
    }

    #[test]
    fn unknown_keys_are_refused_with_the_nearest() {
        let keys = ["tau".to_owned(), "limits".to_owned()];
        let table: Table = "type = \"x\"\ntau = 1\n[limits]\nv = 1".parse().unwrap();
        assert_eq!(check_keys(&table, &keys), Ok(()));
        let table: Table = "limit = 1".parse().unwrap();
        let error = check_keys(&table, &keys).unwrap_err();
        assert_eq!(error.to_string(), "`limit`: unknown field `limit`, expected one of `tau`, `limits`; did you mean `limits`?");
        assert!(check_keys(&table, &[]).unwrap_err().to_string().contains("there are no keys but `type`"));
    }
}
