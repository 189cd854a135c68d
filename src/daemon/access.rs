//! Who calls, and what they may do.

use crate::{
    api::{Fault, FaultKind, Role},
    config::{Access, Config},
};
use axum::{
    extract::FromRequestParts,
    http::{StatusCode, request::Parts},
};
use tokio::net::UnixStream;

/// The user id that the kernel shows for users of another namespace: nobody in particular.
const OVERFLOW_ID: u32 = 65_534;

/// Who is at the other end of a connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Caller {
    /// A process on the Unix socket, by what the kernel says of it.
    Process { uid: u32, gid: u32 },
    /// Somebody on the viewer's socket; its token is checked request by request.
    Browser,
}

impl Caller {
    /// Asks the kernel who connected.
    pub fn of(stream: &UnixStream) -> std::io::Result<Self> {
        let found = stream.peer_cred()?;
        Ok(Self::Process {
            uid: found.uid(),
            gid: found.gid(),
        })
    }

    /// What it may do.
    pub fn role(&self, config: &Config) -> Role {
        let shoots = match self {
            Self::Process { uid, gid } => {
                let own = own_uid();
                may_shoot((*uid, *gid), own, &config.access)
            }
            Self::Browser => config.viewer.may_shoot,
        };
        if shoots { Role::Shoot } else { Role::Look }
    }
}

impl std::fmt::Display for Caller {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Process { uid, .. } => write!(f, "uid {uid}"),
            Self::Browser => write!(f, "the viewer"),
        }
    }
}

/// The user that the daemon runs as.
fn own_uid() -> u32 {
    use std::os::unix::fs::MetadataExt as _;
    // Where the system does not say, only root is known.
    std::fs::metadata("/proc/self").map_or(0, |own| own.uid())
}

fn may_shoot((uid, gid): (u32, u32), own: u32, access: &Access) -> bool {
    let listed = access.shooter_uids.contains(&uid) || access.shooter_gids.contains(&gid);
    uid == 0 || uid == own || (uid != OVERFLOW_ID && listed)
}

/// A caller that may take and delete shots.
pub(super) struct Shooter(pub Caller);

impl FromRequestParts<std::sync::Arc<super::State>> for Shooter {
    type Rejection = (StatusCode, axum::Json<Fault>);

    async fn from_request_parts(
        parts: &mut Parts,
        daemon: &std::sync::Arc<super::State>,
    ) -> Result<Self, Self::Rejection> {
        let caller = parts.extensions.get::<Caller>().cloned();
        match caller {
            Some(caller) if caller.role(&daemon.config.borrow()) == Role::Shoot => Ok(Self(caller)),
            caller => {
                let who = caller.map_or_else(|| "nobody".to_owned(), |caller| caller.to_string());
                let fault = Fault {
                    kind: FaultKind::Request,
                    message: format!("{who} may look, but not take or delete shots"),
                    remedy: Some(
                        "ask as root or as the daemon's user, or have the owner list you under [access] (for the viewer: viewer.may_shoot)".to_owned(),
                    ),
                };
                Err((StatusCode::FORBIDDEN, axum::Json(fault)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn root_the_owner_and_the_listed_may_shoot_and_nobody_else() {
        let access = Access {
            shooter_uids: vec![1000, OVERFLOW_ID],
            shooter_gids: vec![44],
        };
        struct Case(u32, u32, bool);
        for Case(uid, gid, expected) in [
            Case(0, 0, true),
            Case(977, 977, true),
            Case(1000, 1, true),
            Case(1001, 44, true),
            Case(1001, 1001, false),
            // Any user of another namespace: even where its number is listed.
            Case(OVERFLOW_ID, 44, false),
        ] {
            assert_eq!(may_shoot((uid, gid), 977, &access), expected, "{uid} {gid}");
        }
    }
}
