//! The viewer: one page over loopback TCP, and the rules by which browsers may talk to the daemon.
//!
//! Any web page that a browser has open can send requests to a loopback address. So a request is
//! answered only when its `Host` is one of ours (a name that an attacker points here is refused with
//! 421), when no `Origin` or `Sec-Fetch-Site` says that another site sent it, and, beyond the page's own
//! files, when it carries the token. The token stands behind the `#` of the address that the owner is
//! given, which browsers send to nobody; the page trades it for a cookie that no other site's requests
//! carry.

mod guard;
mod page;

pub(super) use guard::Guard;
pub(super) use page::pages;
