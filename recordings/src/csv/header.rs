//! The header line: where it is, what separates its names.

/// The first line that is neither blank nor a comment, if it names columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    /// Column names without quotes and surrounding space.
    pub(super) names: Vec<String>,
    /// What separates cells.
    pub(super) delimiter: u8,
    /// Bytes up to the first data line.
    pub(super) length: usize,
    /// Lines up to the first data line.
    pub(super) lines: u64,
}

impl Header {
    /// Finds the header in a file's first bytes; nothing if the first line is not one.
    pub(super) fn find(head: &[u8]) -> Option<Self> {
        let mut start = if head.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        let mut lines = 0;
        let mut comment: &[u8] = &[];
        while start < head.len() {
            let end = head[start..].iter().position(|&b| b == b'\n').map_or(head.len(), |n| start + n + 1);
            let line = head[start..end].trim_ascii();
            lines += 1;
            match line.strip_prefix(b"#") {
                Some(text) => comment = text.trim_ascii(),
                // A spreadsheet's hint to itself, `sep=;`, is no header either.
                None if line.is_empty() || (line.starts_with(b"sep=") && line.len() == 5) => {}
                None => return Self::parse(line, end, lines).or_else(|| Self::commented(comment, line, start, lines - 1)),
            }
            start = end;
        }
        None
    }

    /// A header in the comment before the first row, as `numpy.savetxt` writes it: it names `t` and has as many names as the
    /// row has numbers.
    fn commented(comment: &[u8], row: &[u8], length: usize, lines: u64) -> Option<Self> {
        let header = Self::parse(comment, length, lines)?;
        let cells = split(row, header.delimiter)?;
        let numbers = cells.iter().all(|cell| crate::number::cell(cell).is_ok());
        (numbers && cells.len() == header.names.len() && header.names.iter().any(|name| name == "t")).then_some(header)
    }

    fn parse(line: &[u8], length: usize, lines: u64) -> Option<Self> {
        let binary = |b: &u8| b.is_ascii_control() && *b != b'\t';
        if line.iter().any(binary) || line.starts_with(b"{") || line.starts_with(b"[") || line.starts_with(b"<") {
            return None;
        }
        let (delimiter, count) = delimiter(line);
        let names: Vec<String> = split(line, delimiter)?.iter().map(|cell| String::from_utf8_lossy(cell).trim().to_owned()).collect();
        let numbers = names.iter().filter(|name| name.parse::<f64>().is_ok()).count();
        if count == 0 || 2 * numbers >= names.len() {
            return None;
        }
        Some(Self { names, delimiter, length, lines })
    }
}

/// The most frequent of the delimiters outside quotes, with how often it is there.
fn delimiter(line: &[u8]) -> (u8, usize) {
    let count = |delimiter: u8| {
        let mut quoted = false;
        let outside = |&&b: &&u8| {
            quoted ^= b == b'"';
            !quoted && b == delimiter
        };
        line.iter().filter(outside).count()
    };
    let mut best = (b',', count(b','));
    for other in [b';', b'\t'] {
        if count(other) > best.1 {
            best = (other, count(other));
        }
    }
    best
}

/// The cells of one record, without its line end; nothing if a quote is left open.
pub(super) fn split(record: &[u8], delimiter: u8) -> Option<Vec<Vec<u8>>> {
    let mut cells = Vec::new();
    let mut cell = Vec::new();
    let mut quoted = false;
    let mut bytes = record.iter().copied().peekable();
    while let Some(byte) = bytes.next() {
        match byte {
            b'"' if quoted && bytes.next_if_eq(&b'"').is_some() => cell.push(b'"'),
            b'"' => quoted = !quoted,
            _ if byte == delimiter && !quoted => cells.push(std::mem::take(&mut cell)),
            _ => cell.push(byte),
        }
    }
    cells.push(cell);
    (!quoted).then_some(cells)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Option<(Vec<String>, u8)> {
        Header::find(text.as_bytes()).map(|h| (h.names, h.delimiter))
    }

    #[test]
    fn headers_are_found_behind_marks_comments_and_blank_lines() {
        let header = Header::find(b"\xef\xbb\xbf# made by hand\r\n\r\n t , \"v, forward\";x\r\n0,1\r\n").unwrap();
        assert_eq!(header.names, ["t", "v, forward;x"]);
        assert_eq!((header.delimiter, header.lines), (b',', 3));
        assert_eq!(names("sep=;\nt;v\n").unwrap().0, ["t", "v"]);
        assert_eq!(names("t;v;omega\n").unwrap().1, b';');
        assert_eq!(names("t\tv\n").unwrap().1, b'\t');
    }

    #[test]
    fn a_commented_header_names_the_columns_if_it_fits_the_first_row() {
        let header = Header::find(b"# made by hand, today\n# t,v\n0.0,1.0\n").unwrap();
        assert_eq!((header.names.len(), header.lines, header.length), (2, 2, 28));
        assert_eq!(names("# t,v,omega\n0.0,1.0\n"), None);
        assert_eq!(names("# made by hand, today\n0.0,1.0\n"), None);
    }

    #[test]
    fn what_is_no_header_is_none() {
        for text in
            ["", "# t,v\n", "0.0,1.0\n", "0.0,forward\n", "{\"a\": 1, \"b\": 2}", "[1, 2]", "<a, b>", "PAR1\x15\x04,x", "only words\n"]
        {
            assert_eq!(names(text), None, "{text:?}");
        }
    }

    #[test]
    fn quotes_hold_delimiters_and_quotes() {
        assert_eq!(split(b"a,\"b,\"\"c\"\"\",", b',').unwrap(), [&b"a"[..], b"b,\"c\"", b""]);
        assert_eq!(split(b"a,\"b", b','), None);
    }
}
