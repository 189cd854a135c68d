//! Events: what a device changed by itself, or another program changed meanwhile.

use super::{Node, Plain, Request, plain};
use std::io;
use v4l::{
    sys::{
        V4L2_EVENT_CTRL, V4L2_EVENT_CTRL_CH_VALUE, V4L2_EVENT_SOURCE_CHANGE, v4l2_event,
        v4l2_event_subscription,
    },
    v4l2::vidioc,
};

/// A control's value changed; subscribe with the control's id.
pub(crate) const CONTROL_CHANGED: u32 = V4L2_EVENT_CTRL;
/// The size or the kind of picture changed; subscribe with id 0.
pub(crate) const SOURCE_CHANGED: u32 = V4L2_EVENT_SOURCE_CHANGE;

/// One event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Event {
    /// The control of this id has another value.
    ControlChanged(u32),
    /// Pictures are not what was negotiated any more.
    SourceChanged,
    /// Something that does not matter here.
    Other,
}

plain!(v4l2_event_subscription, v4l2_event);

const SUBSCRIBE: Request<v4l2_event_subscription> = Request::new(vidioc::VIDIOC_SUBSCRIBE_EVENT);
const TAKE: Request<v4l2_event> = Request::new(vidioc::VIDIOC_DQEVENT);

impl Node {
    /// Asks to hear of `kind` for `id`. Changes made through this node itself are not told.
    pub fn subscribe(&self, kind: u32, id: u32) -> io::Result<()> {
        let mut subscription = v4l2_event_subscription {
            type_: kind,
            id,
            ..Plain::zero()
        };
        // SAFETY: the type holds no pointers.
        unsafe { self.request(&SUBSCRIBE, &mut subscription) }
    }

    /// Takes the next event; an error of kind `NotFound` when there is none.
    pub fn event(&self) -> io::Result<Event> {
        let mut event = v4l2_event::zero();
        // SAFETY: the type holds no pointers.
        unsafe { self.request(&TAKE, &mut event)? };
        Ok(match event.type_ {
            CONTROL_CHANGED => {
                // SAFETY: the kernel fills `ctrl` for this type, and any bits are valid for it.
                let changes = unsafe { event.u.ctrl.changes };
                if changes & V4L2_EVENT_CTRL_CH_VALUE != 0 {
                    Event::ControlChanged(event.id)
                } else {
                    Event::Other
                }
            }
            SOURCE_CHANGED => Event::SourceChanged,
            _ => Event::Other,
        })
    }
}
