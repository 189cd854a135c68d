//! What libusb tells of DepthAI devices that come and go.

use rusb::{Context, Device, Hotplug, HotplugBuilder, UsbContext};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

/// Movidius, whose chips they have.
const VENDOR: u16 = 0x03e7;
/// Longest time that libusb is asked at once.
const ASKING: Duration = Duration::from_secs(60);

/// A thread that listens; it ends with this value.
#[derive(Debug)]
pub(super) struct Events {
    come: Arc<AtomicBool>,
    over: Arc<AtomicBool>,
    context: Context,
    thread: Option<JoinHandle<()>>,
}

/// Notes that something came or went.
struct Note(Arc<AtomicBool>);

impl Hotplug<Context> for Note {
    fn device_arrived(&mut self, _: Device<Context>) {
        self.0.store(true, Ordering::Relaxed);
    }

    fn device_left(&mut self, _: Device<Context>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Events {
    /// Begins to listen.
    ///
    /// # Errors
    /// [`rusb::Error`] where this system's libusb cannot be started or tells nothing.
    pub fn begin() -> rusb::Result<Self> {
        // First: asking for the capability panics where libusb cannot be started.
        let context = Context::new()?;
        if !rusb::has_hotplug() {
            return Err(rusb::Error::NotSupported);
        }
        let (come, over) = (Arc::<AtomicBool>::default(), Arc::<AtomicBool>::default());
        let registration = HotplugBuilder::new()
            .vendor_id(VENDOR)
            .to_owned()
            .register::<Context, _>(&context, Box::new(Note(Arc::clone(&come))))?;
        let (asked, ended) = (context.clone(), Arc::clone(&over));
        let thread = std::thread::Builder::new()
            .name("usb".into())
            .spawn(move || {
                let _registration = registration;
                while !ended.load(Ordering::Relaxed) {
                    if asked.handle_events(Some(ASKING)).is_err() {
                        break;
                    }
                }
            })
            .map_err(|_| rusb::Error::NoMem)?;
        Ok(Self {
            come,
            over,
            context,
            thread: Some(thread),
        })
    }

    /// Whether something came or went since this was last asked.
    pub fn have_come(&mut self) -> bool {
        self.come.swap(false, Ordering::Relaxed)
    }
}

impl Drop for Events {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        self.context.interrupt_handle_events();
        if let Some(thread) = self.thread.take() {
            // Its panic would be libusb's, and nobody is left to hear of it.
            drop(thread.join());
        }
    }
}
