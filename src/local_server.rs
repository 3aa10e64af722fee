//! What servers on this machine ask of whoever comes. A web page from anywhere, opened in a browser on this machine, can reach
//! the loopback address: it cannot choose the Host header, which names the server that it believes to talk to, nor leave out
//! the Origin header of a WebSocket, which names the page.

/// Web pages that may open a WebSocket without the token: the Foxglove app in a browser.
const KNOWN_ORIGINS: [&str; 1] = ["https://app.foxglove.dev"];

/// Whether a Host header means this server by one of its own names. A page that has pointed a name of its own at the loopback
/// address (DNS rebinding) brings that name.
pub fn is_named(host: Option<&str>, port: u16) -> bool {
    let Some(host) = host else { return false };
    ["127.0.0.1", "localhost", "[::1]"]
        .iter()
        .any(|name| host.strip_prefix(name).and_then(|rest| rest.strip_prefix(':')) == Some(&port.to_string()))
}

/// Whether somebody may open a WebSocket: a program that is no browser (it sends no Origin), a page that is known, or whoever
/// knows the token.
pub fn may_enter(origin: Option<&str>, path: &str, token: &str) -> bool {
    let knows = same_bytes(path.trim_matches('/').as_bytes(), token.as_bytes());
    knows || origin.is_none_or(|origin| KNOWN_ORIGINS.contains(&origin))
}

/// In a time that does not tell how much of it was right.
fn same_bytes(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |differences, (a, b)| differences | (a ^ b)) == 0
}

/// 128 bits that nobody can guess, as text for an address.
pub fn token() -> anyhow::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| anyhow::anyhow!("the system has no random numbers: {e}"))?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_from_elsewhere_stay_out() {
        for host in ["127.0.0.1:80", "localhost:80", "[::1]:80"] {
            assert!(is_named(Some(host), 80), "{host}");
        }
        for host in ["evil.com", "evil.com:80", "127.0.0.1:81", "127.0.0.1", "127.0.0.1:80.evil.com", ""] {
            assert!(!is_named(Some(host), 80), "{host}");
        }
        assert!(!is_named(None, 80));
        let token = token().unwrap();
        assert_eq!(token.len(), 32);
        assert!(may_enter(None, "/", &token) && may_enter(Some("https://app.foxglove.dev"), "/", &token));
        for origin in ["http://evil.com", "null", "file://", "https://app.foxglove.dev.evil.com", ""] {
            assert!(!may_enter(Some(origin), "/", &token), "{origin}");
            assert!(!may_enter(Some(origin), &format!("/{}", &token[1..]), &token), "{origin}");
            assert!(may_enter(Some(origin), &format!("/{token}"), &token), "{origin}");
        }
    }
}
