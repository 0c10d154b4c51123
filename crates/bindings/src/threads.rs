//! The threads that kernels run on: one pool for each process.
//!
//! A forked process inherits the memory of its parent, but none of its threads. Work that is handed
//! to an inherited pool waits for ever. Kernels therefore never run on rayon's global pool: every
//! process builds its own pool when it first calls a kernel.

use crate::rows::refuse;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// Pools that one process can inherit: generations of forked processes that each call a kernel.
/// Far more than any program forks; an unused one takes a few bytes.
const GENERATIONS: usize = 64;

/// Owner of a pool that no process has claimed. No process that runs kernels has the id 0.
const NOBODY: u64 = 0;

/// How often the interpreter has been forked on the way from the first process to this one.
static FORKS: AtomicU32 = AtomicU32::new(0);

/// A pool and the process that it belongs to.
struct Slot {
    owner: AtomicU64,
    pool: OnceLock<Result<ThreadPool, String>>,
}

/// The pools of this process and of those that it was forked from; the inherited ones are leaked.
///
/// No process waits for a slot of another one: a fork may happen while another thread of the parent
/// builds a pool, and its lock would stay closed in the child for ever.
static SLOTS: [Slot; GENERATIONS] = [const {
    Slot {
        owner: AtomicU64::new(NOBODY),
        pool: OnceLock::new(),
    }
}; GENERATIONS];

/// What tells this process from those that it was forked from.
///
/// The id alone does not: the system gives it to a new process when an ancestor has ended. The
/// number of forks alone does not either, because programs in C fork without telling Python.
fn this_process() -> u64 {
    u64::from(FORKS.load(Ordering::Relaxed)) << 32 | u64::from(std::process::id())
}

/// Have the interpreter count its forks; systems without forks have no such register.
pub fn count_forks(py: Python<'_>) -> PyResult<()> {
    let Ok(register) = py.import("os")?.getattr("register_at_fork") else {
        return Ok(());
    };
    let count = PyCFunction::new_closure(py, None, None, |_, _| {
        FORKS.fetch_add(1, Ordering::Relaxed);
    })?;
    let hooks = PyDict::new(py);
    hooks.set_item("after_in_child", count)?;
    register.call((), Some(&hooks))?;
    Ok(())
}

/// The pool of this process. `RAYON_NUM_THREADS` gives its size; otherwise it has a thread per core.
fn pool() -> PyResult<&'static ThreadPool> {
    let me = this_process();
    for slot in &SLOTS {
        let claimed = slot
            .owner
            .compare_exchange(NOBODY, me, Ordering::AcqRel, Ordering::Acquire);
        if claimed.is_ok() || claimed == Err(me) {
            let built = slot.pool.get_or_init(|| {
                ThreadPoolBuilder::new()
                    .thread_name(|k| format!("fringeworks-{k}"))
                    .build()
                    .map_err(|error| error.to_string())
            });
            return built.as_ref().map_err(|error| {
                PyRuntimeError::new_err(format!("threads: expected to start them, got: {error}"))
            });
        }
    }
    Err(PyRuntimeError::new_err(format!(
        "threads: expected at most {GENERATIONS} processes forked one from another, got more; \
         start processes with the method spawn"
    )))
}

/// Run a kernel without the interpreter's lock, on the pool of this process.
///
/// Every binding calls its kernel through this function or [`alone`].
pub fn detached<R: Send>(
    py: Python<'_>,
    kernel: impl FnOnce() -> Result<R, fringeworks::Error> + Send,
) -> PyResult<R> {
    py.detach(|| Ok::<_, PyErr>(pool()?.install(kernel)))?
        .map_err(refuse)
}

/// Run a kernel without the interpreter's lock, on the thread that calls it.
///
/// For kernels that use no other threads and take less time than handing them over would.
pub fn alone<R: Send>(
    py: Python<'_>,
    kernel: impl FnOnce() -> Result<R, fringeworks::Error> + Send,
) -> PyResult<R> {
    py.detach(kernel).map_err(refuse)
}
