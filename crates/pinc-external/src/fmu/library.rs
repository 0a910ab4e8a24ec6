//! The functions of an FMU's binary, of FMI 2.0 and 3.0, as safe ones.
//!
//! This is the only place outside of pinc-ad's vectors with `unsafe` code: the binary is loaded at
//! run time and must have the standard's functions. An FMU that breaks the standard can do
//! anything; it is loaded only if its user allows it.
#![expect(unsafe_code, reason = "functions of a library that is loaded at run time")]

use super::description::{FmuKind, Version};
use libloading::Library;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_uint, c_void};
use std::path::Path;
use std::ptr;
use std::sync::Arc;

type Handle = *mut c_void;
/// A function of an instance alone.
type Plain = unsafe extern "C" fn(Handle) -> c_int;
type Write = unsafe extern "C" fn(Handle, *const f64, usize) -> c_int;
type Read = unsafe extern "C" fn(Handle, *mut f64, usize) -> c_int;
type DirectionalOfTwo = unsafe extern "C" fn(
    Handle,
    *const c_uint,
    usize,
    *const c_uint,
    usize,
    *const f64,
    *mut f64,
) -> c_int;
type DirectionalOfThree = unsafe extern "C" fn(
    Handle,
    *const u32,
    usize,
    *const u32,
    usize,
    *const f64,
    usize,
    *mut f64,
    usize,
) -> c_int;

thread_local! {
    /// What the FMU said last of something that went wrong.
    static MESSAGE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// The status from which on a call has failed.
const DISCARD: c_int = 2;

/// Events that follow one another at the start, before it is taken to go on for ever.
const MOST_EVENTS: usize = 1000;

/// The binary with its functions.
pub(super) struct Binary {
    functions: Functions,
    version: Version,
    /// Keeps them in memory.
    _library: Library,
}

/// The functions of both versions, and those in which the versions differ.
struct Functions {
    free: unsafe extern "C" fn(Handle),
    reset: Plain,
    exit_initialization: Plain,
    enter_continuous_time: Option<Plain>,
    set_states: Option<Write>,
    derivatives: Option<Read>,
    versioned: Versioned,
}

enum Versioned {
    Fmi2(Fmi2),
    Fmi3(Fmi3),
}

struct Fmi2 {
    instantiate: unsafe extern "C" fn(
        *const c_char,
        c_int,
        *const c_char,
        *const c_char,
        *const Callbacks,
        c_int,
        c_int,
    ) -> Handle,
    set_up: unsafe extern "C" fn(Handle, c_int, f64, f64, c_int, f64) -> c_int,
    enter_initialization: Plain,
    set: unsafe extern "C" fn(Handle, *const c_uint, usize, *const f64) -> c_int,
    get: unsafe extern "C" fn(Handle, *const c_uint, usize, *mut f64) -> c_int,
    do_step: Option<unsafe extern "C" fn(Handle, f64, f64, c_int) -> c_int>,
    update: Option<unsafe extern "C" fn(Handle, *mut EventInfo) -> c_int>,
    directional: Option<DirectionalOfTwo>,
}

type Log = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);

type NewCoSimulation = unsafe extern "C" fn(
    *const c_char,
    *const c_char,
    *const c_char,
    bool,
    bool,
    bool,
    bool,
    *const u32,
    usize,
    *mut c_void,
    Log,
    *const c_void,
) -> Handle;

struct Fmi3 {
    model_exchange: Option<
        unsafe extern "C" fn(
            *const c_char,
            *const c_char,
            *const c_char,
            bool,
            bool,
            *mut c_void,
            Log,
        ) -> Handle,
    >,
    co_simulation: Option<NewCoSimulation>,
    enter_initialization: unsafe extern "C" fn(Handle, bool, f64, f64, bool, f64) -> c_int,
    set: unsafe extern "C" fn(Handle, *const u32, usize, *const f64, usize) -> c_int,
    get: unsafe extern "C" fn(Handle, *const u32, usize, *mut f64, usize) -> c_int,
    do_step: Option<
        unsafe extern "C" fn(
            Handle,
            f64,
            f64,
            bool,
            *mut bool,
            *mut bool,
            *mut bool,
            *mut f64,
        ) -> c_int,
    >,
    update: Option<
        unsafe extern "C" fn(
            Handle,
            *mut bool,
            *mut bool,
            *mut bool,
            *mut bool,
            *mut bool,
            *mut f64,
        ) -> c_int,
    >,
    directional: Option<DirectionalOfThree>,
}

/// `fmi2EventInfo`.
#[repr(C)]
#[derive(Default)]
struct EventInfo {
    again: c_int,
    terminate: c_int,
    nominals_changed: c_int,
    values_changed: c_int,
    next_defined: c_int,
    next: f64,
}

/// `fmi2CallbackFunctions`. The logger has further arguments for its format, which are not read.
#[repr(C)]
struct Callbacks {
    logger: unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char),
    allocate: unsafe extern "C" fn(usize, usize) -> *mut c_void,
    free: unsafe extern "C" fn(*mut c_void),
    step_finished: *const c_void,
    environment: *mut c_void,
}

// SAFETY: functions of every C library, which programs on these systems are linked with.
unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(memory: *mut c_void);
}

fn remember(status: c_int, message: *const c_char) {
    if status < DISCARD || message.is_null() {
        return;
    }
    // SAFETY: the standard says that it is a text that ends in 0.
    let text = unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned();
    MESSAGE.with_borrow_mut(|to| *to = text);
}

unsafe extern "C" fn log_of_two(
    _: *mut c_void,
    _: *const c_char,
    status: c_int,
    _: *const c_char,
    message: *const c_char,
) {
    remember(status, message);
}

unsafe extern "C" fn log_of_three(
    _: *mut c_void,
    status: c_int,
    _: *const c_char,
    message: *const c_char,
) {
    remember(status, message);
}

impl Binary {
    /// Loads the file at `path`; or says, in words, why that cannot be done.
    pub(super) fn load(path: &Path, version: Version) -> Result<Self, String> {
        // SAFETY: what a library does when it is loaded is for the FMU to keep to the standard.
        let library = unsafe { Library::new(path) }.map_err(|error| in_full(&error))?;
        // SAFETY: the standard's functions of these names have these types.
        let functions = unsafe { functions(&library, version) }?;
        Ok(Self { functions, version, _library: library })
    }
}

/// An error with what it was caused by, where the system's own words are.
fn in_full(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(Some(error), |error| error.source());
    causes.map(ToString::to_string).collect::<Vec<_>>().join(": ")
}

/// # Safety
///
/// `T` is the type of the function of this name.
unsafe fn find<T: Copy>(library: &Library, name: &str) -> Result<T, String> {
    // SAFETY: as of this function.
    let symbol = unsafe { library.get::<T>(name.as_bytes()) };
    symbol.map(|symbol| *symbol).map_err(|_| format!("its binary has no function {name}"))
}

/// The functions of a version of FMI.
///
/// # Safety
///
/// The library keeps to the standard.
unsafe fn functions(library: &Library, version: Version) -> Result<Functions, String> {
    let (prefix, derivatives) = match version {
        Version::Two => ("fmi2", "GetDerivatives"),
        Version::Three => ("fmi3", "GetContinuousStateDerivatives"),
    };
    let named = |name: &str| format!("{prefix}{name}");
    // SAFETY: these are the types of the standard.
    unsafe {
        Ok(Functions {
            free: find(library, &named("FreeInstance"))?,
            reset: find(library, &named("Reset"))?,
            exit_initialization: find(library, &named("ExitInitializationMode"))?,
            enter_continuous_time: find(library, &named("EnterContinuousTimeMode")).ok(),
            set_states: find(library, &named("SetContinuousStates")).ok(),
            derivatives: find(library, &named(derivatives)).ok(),
            versioned: match version {
                Version::Two => Versioned::Fmi2(Fmi2 {
                    instantiate: find(library, "fmi2Instantiate")?,
                    set_up: find(library, "fmi2SetupExperiment")?,
                    enter_initialization: find(library, "fmi2EnterInitializationMode")?,
                    set: find(library, "fmi2SetReal")?,
                    get: find(library, "fmi2GetReal")?,
                    do_step: find(library, "fmi2DoStep").ok(),
                    update: find(library, "fmi2NewDiscreteStates").ok(),
                    directional: find(library, "fmi2GetDirectionalDerivative").ok(),
                }),
                Version::Three => Versioned::Fmi3(Fmi3 {
                    model_exchange: find(library, "fmi3InstantiateModelExchange").ok(),
                    co_simulation: find(library, "fmi3InstantiateCoSimulation").ok(),
                    enter_initialization: find(library, "fmi3EnterInitializationMode")?,
                    set: find(library, "fmi3SetFloat64")?,
                    get: find(library, "fmi3GetFloat64")?,
                    do_step: find(library, "fmi3DoStep").ok(),
                    update: find(library, "fmi3UpdateDiscreteStates").ok(),
                    directional: find(library, "fmi3GetDirectionalDerivative").ok(),
                }),
            },
        })
    }
}

/// One instance of an FMU.
pub(super) struct Instance {
    binary: Arc<Binary>,
    handle: Handle,
    /// When each step begins.
    start_s: f64,
    /// What it was told, which it may keep.
    _texts: [CString; 3],
    _callbacks: Box<Callbacks>,
}

// SAFETY: the standard lets an instance be used by any thread, by one at a time.
unsafe impl Send for Instance {}

/// The result of a call; `what` names it.
fn checked(what: &str, status: c_int) -> Result<(), String> {
    if status < DISCARD {
        return Ok(());
    }
    let message = MESSAGE.take();
    let message = message.trim();
    let colon = if message.is_empty() { "" } else { ": " };
    Err(format!("the FMU's {what} failed{colon}{message}"))
}

fn missing(what: &str) -> String {
    format!("the FMU's binary has no function for {what}")
}

impl Instance {
    /// A new instance; `resources` is the path of the FMU's directory of that name.
    pub(super) fn new(
        binary: &Arc<Binary>,
        (kind, start_s): (FmuKind, f64),
        token: &str,
        resources: &Path,
    ) -> Result<Self, String> {
        let resources = resources.display().to_string();
        let resources = match binary.version {
            Version::Two => format!("file://{resources}"),
            Version::Three => format!("{resources}/"),
        };
        let text = |text: &str| CString::new(text).map_err(|error| error.to_string());
        let texts = [text("pinc")?, text(token)?, text(&resources)?];
        let [name, token, resources] = &texts;
        let (name, token, resources) = (name.as_ptr(), token.as_ptr(), resources.as_ptr());
        let callbacks = Box::new(Callbacks {
            logger: log_of_two,
            allocate: calloc,
            free,
            step_finished: ptr::null(),
            environment: ptr::null_mut(),
        });
        let none = ptr::null_mut();
        // SAFETY: all that is pointed to lives as long as the instance; the null pointers are those
        // that the standard allows.
        let handle = unsafe {
            match (&binary.functions.versioned, kind) {
                (Versioned::Fmi2(of), kind) => {
                    let kind = c_int::from(kind == FmuKind::CoSimulation);
                    (of.instantiate)(name, kind, token, resources, &raw const *callbacks, 0, 0)
                }
                (Versioned::Fmi3(of), FmuKind::ModelExchange) => {
                    let new = of.model_exchange.ok_or_else(|| missing("model exchange"))?;
                    new(name, token, resources, false, false, none, log_of_three)
                }
                (Versioned::Fmi3(of), FmuKind::CoSimulation) => {
                    let new = of.co_simulation.ok_or_else(|| missing("co-simulation"))?;
                    let (log, nothing): (Log, *const c_void) = (log_of_three, ptr::null());
                    new(
                        name,
                        token,
                        resources,
                        false,
                        false,
                        false,
                        false,
                        nothing.cast(),
                        0,
                        none,
                        log,
                        nothing,
                    )
                }
            }
        };
        if handle.is_null() {
            return Err(checked("instantiation", DISCARD).err().unwrap_or_default());
        }
        Ok(Self { binary: binary.clone(), handle, start_s, _texts: texts, _callbacks: callbacks })
    }

    /// Begins again at the start time with these start values.
    pub(super) fn restart(&mut self, references: &[u32], values: &[f64]) -> Result<(), String> {
        self.initialize(references, values)?;
        self.end_initialization()
    }

    /// Begins again, and leaves the FMU in its initialization.
    pub(super) fn initialize(&mut self, references: &[u32], values: &[f64]) -> Result<(), String> {
        let binary = self.binary.clone();
        let of = &binary.functions;
        // SAFETY: the instance lives; the lengths are the slices' own.
        unsafe {
            checked("reset", (of.reset)(self.handle))?;
            self.set(references, values)?;
            match &of.versioned {
                Versioned::Fmi2(own) => {
                    checked("set-up", (own.set_up)(self.handle, 0, 0.0, self.start_s, 0, 0.0))?;
                    checked("initialization", (own.enter_initialization)(self.handle))?;
                }
                Versioned::Fmi3(own) => {
                    let enter = own.enter_initialization;
                    let status = enter(self.handle, false, 0.0, self.start_s, false, 0.0);
                    checked("initialization", status)?;
                }
            }
        }
        Ok(())
    }

    pub(super) fn end_initialization(&mut self) -> Result<(), String> {
        // SAFETY: as above.
        let status = unsafe { (self.binary.functions.exit_initialization)(self.handle) };
        checked("initialization", status)
    }

    /// Sets variables, whose elements follow one another in `values`.
    fn set(&mut self, references: &[u32], values: &[f64]) -> Result<(), String> {
        let (vr, count) = (references.as_ptr(), references.len());
        // SAFETY: as above; a variable of version 2 has one element.
        let status = unsafe {
            match &self.binary.functions.versioned {
                Versioned::Fmi2(of) => {
                    assert_eq!(count, values.len(), "one value per variable");
                    (of.set)(self.handle, vr, count, values.as_ptr())
                }
                Versioned::Fmi3(of) => {
                    (of.set)(self.handle, vr, count, values.as_ptr(), values.len())
                }
            }
        };
        checked("setting of variables", status)
    }

    /// Reads variables, whose elements follow one another in `values`.
    pub(super) fn get(&mut self, references: &[u32], values: &mut [f64]) -> Result<(), String> {
        let (vr, count, to) = (references.as_ptr(), references.len(), values.as_mut_ptr());
        // SAFETY: as above.
        let status = unsafe {
            match &self.binary.functions.versioned {
                Versioned::Fmi2(of) => {
                    assert_eq!(count, values.len(), "one value per variable");
                    (of.get)(self.handle, vr, count, to)
                }
                Versioned::Fmi3(of) => (of.get)(self.handle, vr, count, to, values.len()),
            }
        };
        checked("reading of variables", status)
    }

    /// Lets the FMU integrate itself, from `after_s` seconds after the start.
    pub(super) fn do_step(&mut self, after_s: f64, duration_s: f64) -> Result<(), String> {
        let (what, now_s) = ("co-simulation", self.start_s + after_s);
        let (mut event, mut end, mut early, mut last) = (false, false, false, 0.0);
        // SAFETY: as above.
        let status = unsafe {
            match &self.binary.functions.versioned {
                Versioned::Fmi2(of) => {
                    let step = of.do_step.ok_or_else(|| missing(what))?;
                    step(self.handle, now_s, duration_s, 1)
                }
                Versioned::Fmi3(of) => {
                    let step = of.do_step.ok_or_else(|| missing(what))?;
                    let (event, end) = (&raw mut event, &raw mut end);
                    let (early, last) = (&raw mut early, &raw mut last);
                    step(self.handle, now_s, duration_s, true, event, end, early, last)
                }
            }
        };
        checked("step", status)?;
        match end || early {
            true => Err("the FMU ended its simulation within a step".to_owned()),
            false => Ok(()),
        }
    }

    /// Goes from initialization to where f(x, u) is evaluated.
    pub(super) fn begin_continuous_time(&mut self) -> Result<(), String> {
        let what = "model exchange";
        for _ in 0..MOST_EVENTS {
            let mut info = EventInfo::default();
            let mut flags = [false; 5];
            // SAFETY: as above.
            let (status, again) = unsafe {
                match &self.binary.functions.versioned {
                    Versioned::Fmi2(of) => {
                        let update = of.update.ok_or_else(|| missing(what))?;
                        (update(self.handle, &raw mut info), info.again != 0)
                    }
                    Versioned::Fmi3(of) => {
                        let update = of.update.ok_or_else(|| missing(what))?;
                        let [a, b, c, d, e] = &mut flags;
                        let status = update(self.handle, a, b, c, d, e, &raw mut info.next);
                        (status, flags[0])
                    }
                }
            };
            checked("event", status)?;
            if !again {
                let enter = self.binary.functions.enter_continuous_time;
                // SAFETY: as above.
                let status = unsafe { enter.ok_or_else(|| missing(what))?(self.handle) };
                return checked("entry into continuous time", status);
            }
        }
        Err("the FMU's events at the start do not come to an end".to_owned())
    }

    /// Writes f(x, u) into `dx`.
    pub(super) fn derivatives(&mut self, x: &[f64], dx: &mut [f64]) -> Result<(), String> {
        let Functions { set_states, derivatives, .. } = &self.binary.functions;
        let (Some(set), Some(get)) = (set_states, derivatives) else {
            return Err(missing("model exchange"));
        };
        // SAFETY: as above.
        unsafe {
            checked("setting of states", set(self.handle, x.as_ptr(), x.len()))?;
            checked("derivatives", get(self.handle, dx.as_mut_ptr(), dx.len()))
        }
    }
}

impl Instance {
    /// Writes into `slope` the derivative of `unknowns` where `knowns` change by `seed`.
    pub(super) fn directional_derivative(
        &mut self,
        unknowns: &[u32],
        knowns: &[u32],
        seed: &[f64],
        slope: &mut [f64],
    ) -> Result<(), String> {
        let what = "directional derivatives";
        let (to, to_count) = (unknowns.as_ptr(), unknowns.len());
        let (from, from_count) = (knowns.as_ptr(), knowns.len());
        // SAFETY: as above; a variable of version 2 has one element.
        let status = unsafe {
            match &self.binary.functions.versioned {
                Versioned::Fmi2(of) => {
                    assert_eq!([to_count, from_count], [slope.len(), seed.len()], "one value each");
                    let get = of.directional.ok_or_else(|| missing(what))?;
                    let (seed, slope) = (seed.as_ptr(), slope.as_mut_ptr());
                    get(self.handle, to, to_count, from, from_count, seed, slope)
                }
                Versioned::Fmi3(of) => {
                    let get = of.directional.ok_or_else(|| missing(what))?;
                    let (n, seed) = (seed.len(), seed.as_ptr());
                    let (m, slope) = (slope.len(), slope.as_mut_ptr());
                    get(self.handle, to, to_count, from, from_count, seed, n, slope, m)
                }
            }
        };
        checked("directional derivative", status)
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: it was not freed before.
        unsafe { (self.binary.functions.free)(self.handle) };
    }
}
