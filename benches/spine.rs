//! CSV parse with corrected identification at three sizes, and MCAP reading.
//!
//! The recordings are made by `benches/peers/make_data.py FOLDER`; `WHEELWRIGHT_BENCH_DATA` names the folder. Without it the
//! benchmarks say so and are skipped.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use wheelwright::prelude::*;

fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("WHEELWRIGHT_BENCH_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: WHEELWRIGHT_BENCH_DATA does not name the folder made by benches/peers/make_data.py");
    }
    folder
}

fn identify_csv(path: &Path) -> Vec<f64> {
    let read = || -> Result<Vec<f64>, Box<dyn std::error::Error>> {
        let recording = wheelwright::recordings::open(path, &ReadOptions::default())?;
        let model = VwPdConfig::default().build()?;
        let (train, held_out) = Dataset::new(&recording, &*model)?.hold_out(0.3);
        Ok(identify(&Problem::new(&*model, &train), &Ols::default(), &held_out)?.solution.theta)
    };
    read().unwrap_or_default()
}

fn csv_to_theta(criterion: &mut Criterion) {
    let Some(folder) = folder() else { return };
    let mut group = criterion.benchmark_group("csv_to_theta");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    for rows in [3_000u64, 100_000, 1_000_000] {
        let path = folder.join(format!("{rows}.csv"));
        group.throughput(Throughput::Elements(rows));
        group.bench_with_input(BenchmarkId::from_parameter(rows), &path, |b, path| b.iter(|| black_box(identify_csv(path))));
    }
    group.finish();
}

fn mcap_read(criterion: &mut Criterion) {
    let Some(folder) = folder() else { return };
    let path = folder.join("million.mcap");
    let mut group = criterion.benchmark_group("mcap_read");
    group.sample_size(10).measurement_time(Duration::from_secs(5)).throughput(Throughput::Elements(1_000_000));
    group.bench_function("million_messages", |b| {
        b.iter(|| black_box(wheelwright::recordings::open(&path, &ReadOptions::default()).is_ok()))
    });
    group.finish();
}

criterion_group!(benches, csv_to_theta, mcap_read);
criterion_main!(benches);
