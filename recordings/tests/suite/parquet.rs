//! Parquet files of two writers: the official one of Python and the library's own.

use std::sync::Arc;

use crate::common::{map, mapping, open_bytes};
use parquet::basic::{Compression, Encoding};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use proptest::prelude::*;
use wheelwright_core::recording::{ReadError, ReadOptions, RecordingError};

/// Written by pyarrow 26:
///
/// ```python
/// n = 40; k = np.arange(n)
/// table = pa.table({
///     "t": pa.array((1_700_000_000_000_000 + 50_000 * k).astype("datetime64[us]")),
///     "segment": pa.array(["out"] * 25 + ["back"] * 15).dictionary_encode(),
///     "v_ref": 0.25 * (k % 3), "v": pa.array((0.125 * (k % 5)).astype("float32")),
///     "count": pa.array(k.astype("int32")), "note": ["a"] * n,
///     "holes": pa.array([None if i == 7 else float(i) for i in range(n)]),
/// })
/// pq.write_table(table, "pyarrow.parquet", compression="zstd", row_group_size=16)
/// ```
const PYARROW: &[u8] = include_bytes!("../data/pyarrow.parquet");

/// Values of a column to write.
enum Column {
    Doubles(Vec<Option<f64>>),
    Integers(Vec<i64>),
    Texts(Vec<&'static str>),
}

fn doubles(values: impl IntoIterator<Item = f64>) -> Column {
    Column::Doubles(values.into_iter().map(Some).collect())
}

/// A file of one row group; the schema's columns are written in order.
fn write(schema: &str, columns: &[Column]) -> Vec<u8> {
    let schema = Arc::new(parse_message_type(&format!("message m {{ {schema} }}")).unwrap());
    let properties =
        WriterProperties::builder().set_compression(Compression::SNAPPY).set_dictionary_enabled(false).set_encoding(Encoding::PLAIN);
    let mut bytes = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties.build())).unwrap();
    let mut group = writer.next_row_group().unwrap();
    for column in columns {
        let mut chunk = group.next_column().unwrap().unwrap();
        match column {
            Column::Doubles(values) => {
                let levels: Vec<i16> = values.iter().map(|v| i16::from(v.is_some())).collect();
                let present: Vec<f64> = values.iter().flatten().copied().collect();
                chunk.typed::<DoubleType>().write_batch(&present, Some(&levels), None).unwrap();
            }
            Column::Integers(values) => {
                chunk.typed::<Int64Type>().write_batch(values, None, None).unwrap();
            }
            Column::Texts(values) => {
                let texts: Vec<ByteArray> = values.iter().map(|v| ByteArray::from(*v)).collect();
                chunk.typed::<ByteArrayType>().write_batch(&texts, None, None).unwrap();
            }
        }
        chunk.close().unwrap();
    }
    group.close().unwrap();
    writer.close().unwrap();
    bytes
}

fn refusal(schema: &str, columns: &[Column]) -> String {
    open_bytes(&write(schema, columns), &ReadOptions::default()).map(|r| r.rows()).unwrap_err().to_string()
}

const TV: &str = "optional double t; optional double v;";

#[test]
fn a_file_of_the_official_writer_is_read() {
    let read = open_bytes(PYARROW, &ReadOptions::default()).unwrap();
    assert_eq!(read.source.format, "parquet");
    assert_eq!(read.rows(), 40);
    assert!(read.time().iter().enumerate().all(|(k, t)| (t - 0.05 * k as f64).abs() < 1e-12));
    let segments: Vec<_> = read.segments().iter().map(|s| (s.label.as_str(), s.rows.clone())).collect();
    assert_eq!(segments, [("out", 0..25), ("back", 25..40)]);
    let names: Vec<_> = read.columns().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["v_ref", "v", "count"]);
    for k in 0..40 {
        assert_eq!(read.column("v_ref").unwrap()[k], 0.25 * (k % 3) as f64);
        assert_eq!(read.column("v").unwrap()[k], 0.125 * (k % 5) as f64);
        assert_eq!(read.column("count").unwrap()[k], k as f64);
    }
    assert_eq!(read.warnings, ["row 8, column `holes`: no value: the column is left out"]);
    assert_eq!(read.streams.iter().map(|s| s.used).collect::<Vec<_>>(), [true, true, true, true, true, false, false]);
}

#[test]
fn stamps_integers_and_mappings_are_read() {
    let schema = "required int64 stamp (TIMESTAMP(MILLIS,true)); required int64 ticks; required int64 run;";
    let columns = [
        Column::Integers(vec![1_700_000_000_000, 1_700_000_000_020, 1_700_000_000_040]),
        Column::Integers(vec![0, 500, -500]),
        Column::Integers(vec![1, 1, 2]),
    ];
    let options = mapping(vec![map("t", "stamp", 1.0, 0.0), map("v", "ticks", 1e-3, 0.0)]);
    let read = open_bytes(&write(schema, &columns), &options).unwrap();
    assert_eq!(read.time(), [0.0, 0.02, 0.04]);
    assert_eq!(read.column("v").unwrap(), [0.0, 0.5, -0.5]);
    assert_eq!(read.segments().iter().map(|s| s.label.as_str()).collect::<Vec<_>>(), ["1", "2"]);
}

#[test]
fn faults_are_refused_at_their_place() {
    let t = || doubles([0.0, 1.0, 2.0]);
    let with_v = |v: [Option<f64>; 3]| refusal(TV, &[t(), Column::Doubles(v.to_vec())]);
    assert_eq!(with_v([Some(0.0), None, Some(1.0)]), "row 2, column `v`: no value; fill it or remove the row");
    assert!(with_v([Some(0.0), Some(f64::NAN), Some(1.0)]).starts_with("row 2, column `v`: NaN is not a finite number"));
    assert!(with_v([Some(1.0); 3]).starts_with("no motion"));
    assert!(refusal(TV, &[doubles([0.0, 2.0, 1.0]), t()]).starts_with("row 3: time goes back from 2 s to 1 s"));
    assert!(
        refusal("required binary t (UTF8);", &[Column::Texts(vec!["a", "b"])]).starts_with("column `t`: its type is not one that is read")
    );
    let error = open_bytes(&write("optional double time;", &[t()]), &ReadOptions::default()).unwrap_err();
    assert!(matches!(error, ReadError::Content(RecordingError::MissingColumn { .. })), "{error}");
}

#[test]
fn files_cut_short_or_with_false_lengths_are_refused() {
    let whole = write(TV, &[doubles((0..500).map(f64::from)), doubles((0..500).map(|k| f64::from(k % 7)))]);
    let message = |bytes: &[u8]| open_bytes(bytes, &ReadOptions::default()).map(|r| r.rows()).unwrap_err().to_string();
    assert!(message(&whole[..whole.len() / 2]).contains("the file was cut short: Parquet keeps its table of contents at the end"));
    assert!(message(b"PAR1").contains("ends behind its first bytes"));
    let mut claims = whole.clone();
    let at = claims.len() - 8;
    claims[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(message(&claims).contains("it claims 4294967295 bytes"), "{}", message(&claims));
    let mut encrypted = whole;
    encrypted.truncate(at + 4);
    encrypted.extend(b"PARE");
    assert!(message(&encrypted).contains("without encryption"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn no_damage_panics(at in any::<prop::sample::Index>(), byte in any::<u8>(), second in any::<prop::sample::Index>(), other in any::<u8>()) {
        let mut bytes = PYARROW.to_vec();
        bytes[at.index(PYARROW.len())] = byte;
        let _ = open_bytes(&bytes, &ReadOptions::default());
        // The footer is where lengths and counts stand.
        let footer = PYARROW.len() - 2_800;
        bytes[footer + second.index(2_800)] = other;
        let _ = open_bytes(&bytes, &ReadOptions::default());
        let _ = open_bytes(&PYARROW[..at.index(PYARROW.len())], &ReadOptions::default());
    }
}
