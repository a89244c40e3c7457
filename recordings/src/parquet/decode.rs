//! Column chunks of a Parquet file as numbers or labels.

use parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType, Int96};
use parquet::errors::ParquetError;
use parquet::schema::types::ColumnDescriptor;

/// Rows decoded at a time.
const BATCH: usize = 1 << 14;

/// What the values of a column are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    /// Numbers; integers may be unsigned, decimals are scaled.
    Number { unsigned: bool, scale: f64 },
    /// Points in time, in units of so many seconds; given as seconds since the column's first.
    Stamp { seconds: f64 },
    /// Text.
    Text,
    /// Nested or of another type.
    Other,
}

impl Kind {
    /// What a column's description says.
    pub(super) fn of(column: &ColumnDescriptor) -> Self {
        if column.max_rep_level() > 0 || column.path().parts().len() != 1 {
            return Self::Other;
        }
        let logical = column.logical_type_ref();
        let stamp = match (logical, column.converted_type()) {
            (Some(LogicalType::Timestamp(t) | LogicalType::Time(t)), _) => Some(match t.unit {
                TimeUnit::MILLIS => 1e-3,
                TimeUnit::MICROS => 1e-6,
                TimeUnit::NANOS => 1e-9,
            }),
            (_, ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS) => Some(1e-3),
            (_, ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS) => Some(1e-6),
            _ => None,
        };
        match column.physical_type() {
            Type::INT96 => Self::Stamp { seconds: 1e-9 },
            Type::INT32 | Type::INT64 => match stamp {
                Some(seconds) => Self::Stamp { seconds },
                None => Self::Number { unsigned: is_unsigned(column), scale: decimal_scale(column) },
            },
            Type::FLOAT | Type::DOUBLE => Self::Number { unsigned: false, scale: 1.0 },
            Type::BYTE_ARRAY if matches!(logical, Some(LogicalType::String | LogicalType::Enum)) => Self::Text,
            Type::BYTE_ARRAY if matches!(column.converted_type(), ConvertedType::UTF8 | ConvertedType::ENUM) => Self::Text,
            _ => Self::Other,
        }
    }
}

fn is_unsigned(column: &ColumnDescriptor) -> bool {
    use ConvertedType::{UINT_8, UINT_16, UINT_32, UINT_64};
    let logical = matches!(column.logical_type_ref(), Some(LogicalType::Integer(int)) if !int.is_signed);
    logical || matches!(column.converted_type(), UINT_8 | UINT_16 | UINT_32 | UINT_64)
}

fn decimal_scale(column: &ColumnDescriptor) -> f64 {
    let decimal = matches!(column.logical_type_ref(), Some(LogicalType::Decimal(_))) || column.converted_type() == ConvertedType::DECIMAL;
    if decimal { 10f64.powi(-column.type_scale().clamp(0, 300)) } else { 1.0 }
}

/// The values of one column over the row groups read so far.
#[derive(Debug, Default)]
pub(super) struct Decoded {
    pub(super) numbers: Vec<f64>,
    pub(super) labels: Vec<String>,
    /// First row, from 1, without a value.
    pub(super) null: Option<usize>,
    origin: Option<i64>,
}

impl Decoded {
    /// Rows so far.
    pub(super) fn rows(&self) -> usize {
        self.numbers.len() + self.labels.len()
    }

    /// Appends a column chunk of at most `limit` rows; stops at the first missing value.
    ///
    /// # Errors
    /// The decoder's, or that the chunk holds more rows.
    pub(super) fn append(&mut self, reader: ColumnReader, kind: Kind, limit: usize) -> Result<(), ParquetError> {
        match (reader, kind) {
            (ColumnReader::DoubleColumnReader(reader), Kind::Number { .. }) => self.each(reader, limit, |all, v| all.numbers.push(*v)),
            (ColumnReader::FloatColumnReader(reader), Kind::Number { .. }) => {
                self.each(reader, limit, |all, v| all.numbers.push(f64::from(*v)))
            }
            (ColumnReader::Int32ColumnReader(reader), Kind::Number { unsigned, scale }) => {
                let number = |v: i32| if unsigned { f64::from(v as u32) } else { f64::from(v) };
                self.each(reader, limit, |all, v| all.numbers.push(scale * number(*v)))
            }
            (ColumnReader::Int64ColumnReader(reader), Kind::Number { unsigned, scale }) => {
                let number = |v: i64| if unsigned { v as u64 as f64 } else { v as f64 };
                self.each(reader, limit, |all, v| all.numbers.push(scale * number(*v)))
            }
            (ColumnReader::Int32ColumnReader(reader), Kind::Stamp { seconds }) => {
                self.each(reader, limit, |all, v| all.stamp(i64::from(*v), seconds))
            }
            (ColumnReader::Int64ColumnReader(reader), Kind::Stamp { seconds }) => self.each(reader, limit, |all, v| all.stamp(*v, seconds)),
            (ColumnReader::Int96ColumnReader(reader), Kind::Stamp { seconds }) => {
                self.each(reader, limit, |all, v: &Int96| all.stamp(v.to_nanos(), seconds))
            }
            (ColumnReader::ByteArrayColumnReader(reader), Kind::Text) => {
                self.each(reader, limit, |all, v: &ByteArray| all.labels.push(String::from_utf8_lossy(v.data()).into_owned()))
            }
            _ => Err(ParquetError::General("the column's type changes within the file".to_owned())),
        }
    }

    /// Seconds since the first stamp: the difference of integers loses nothing.
    fn stamp(&mut self, value: i64, seconds: f64) {
        let origin = *self.origin.get_or_insert(value);
        self.numbers.push((i128::from(value) - i128::from(origin)) as f64 * seconds);
    }

    fn each<T: DataType>(
        &mut self,
        mut reader: ColumnReaderImpl<T>,
        limit: usize,
        mut push: impl FnMut(&mut Self, &T::T),
    ) -> Result<(), ParquetError> {
        let (mut values, mut levels) = (Vec::new(), Vec::new());
        let mut total = 0;
        while self.null.is_none() {
            values.clear();
            levels.clear();
            let (rows, present, _) = reader.read_records(BATCH, Some(&mut levels), None, &mut values)?;
            total += rows;
            if total > limit {
                return Err(ParquetError::General(format!("more than the {limit} rows that the footer states")));
            }
            if rows == 0 {
                break;
            }
            if present < rows {
                self.null = levels.iter().position(|level| *level == 0).map(|missing| self.rows() + missing + 1);
            }
            values.iter().for_each(|value| push(self, value));
        }
        Ok(())
    }
}
