//! A watch over models, whose calls run on the caller's own thread and so have no deadline.
//!
//! Each model counts the calls that began and ended. A thread looks at the counts now and then; a model in which calls began
//! that have not ended, and in which nothing changes from look to look, hangs. Nothing can call a thread back out of it, so
//! the watcher is told, who may end the program.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread;
use std::time::Duration;

use crate::deadline::{abandon, start};

/// Looks without a change after which a call is said to hang.
const LOOKS: u32 = 8;

/// Every model that is alive.
static MODELS: Mutex<Vec<Weak<Calls>>> = Mutex::new(Vec::new());

/// Calls of one model.
#[derive(Debug)]
pub(crate) struct Calls {
    name: &'static str,
    begun: AtomicU64,
    ended: AtomicU64,
}

impl Calls {
    /// Counts for a new model.
    pub(crate) fn new(name: &'static str) -> Arc<Self> {
        let calls = Arc::new(Self { name, begun: AtomicU64::new(0), ended: AtomicU64::new(0) });
        let mut models = MODELS.lock().unwrap_or_else(PoisonError::into_inner);
        models.retain(|model| model.strong_count() > 0);
        models.push(Arc::downgrade(&calls));
        calls
    }

    /// Counts a call. The counts are only compared with themselves, so no order is needed.
    pub(crate) fn count<T>(&self, call: impl FnOnce() -> T) -> T {
        self.begun.fetch_add(1, Ordering::Relaxed);
        let result = call();
        self.ended.fetch_add(1, Ordering::Relaxed);
        result
    }

    fn counts(&self) -> (u64, u64) {
        (self.begun.load(Ordering::Relaxed), self.ended.load(Ordering::Relaxed))
    }
}

/// Looks after the models of plugins from now on: `on_hang` is called, once and from another thread, with the name of a model
/// in which a call has not returned for about `limit`. A program says so and ends with [`exit`](crate::exit).
///
/// Without a thread to look from there is no watch; everything else works.
pub fn watch_models(limit: Duration, on_hang: impl FnOnce(&str) + Send + 'static) {
    let look = move || {
        let mut seen: Vec<((u64, u64), u32)> = Vec::new();
        loop {
            thread::sleep(limit / LOOKS);
            let models: Vec<_> = MODELS.lock().unwrap_or_else(PoisonError::into_inner).iter().filter_map(Weak::upgrade).collect();
            let now = models.iter().map(|model| {
                let counts = model.counts();
                let before = seen.iter().find(|(old, _)| *old == counts && counts.0 != counts.1);
                (counts, before.map_or(0, |(_, looks)| looks + 1))
            });
            let now: Vec<_> = now.collect();
            if let Some((model, _)) = models.iter().zip(&now).find(|(_, (_, looks))| *looks >= LOOKS) {
                abandon();
                return on_hang(model.name);
            }
            seen = now;
        }
    };
    // As documented.
    let _ = start("watch", look);
}
