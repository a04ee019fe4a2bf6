//! Access to the dashboard: requests to this machine's own address, from its own pages, with the token. Checked before
//! any other handler, by the serving thread.
//!
//! The token is in the first address and becomes a cookie that scripts cannot read, because a browser's `EventSource`
//! sends no headers of its own. The host is checked against DNS rebinding (a foreign name that resolves to 127.0.0.1), the
//! origin against forms and scripts of other pages.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use rcc_api::own_hosts::{OwnHosts, is_own_page};
use rcc_api::token::Token;

/// Content security policy of the pages: nothing of other origins, no inline script, no frame around them.
const POLICY: &str = "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'";

/// Access rules of one server.
#[derive(Debug)]
pub struct Access {
    token: Token,
    hosts: OwnHosts,
    cookie: String,
    /// Token for `/metrics`, which opens nothing else.
    scraper: Option<Token>,
    metrics_open: bool,
}

/// The reason why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// `host` is not an address of this server.
    Host,
    /// The request comes from a page of another origin, or from no page.
    Origin,
    /// No token.
    NoToken,
    /// Another token.
    WrongToken,
    /// No token for `/metrics`.
    NoScraperToken,
    /// Another token than that for `/metrics`.
    WrongScraperToken,
}

impl Refusal {
    fn refusal_text(self) -> (StatusCode, &'static str) {
        match self {
            Refusal::Host => (
                StatusCode::MISDIRECTED_REQUEST,
                "this server answers to 127.0.0.1 and localhost only: use the address that it printed",
            ),
            Refusal::Origin => (
                StatusCode::FORBIDDEN,
                "requests from other pages are refused: use the dashboard's own page",
            ),
            Refusal::NoToken => (
                StatusCode::UNAUTHORIZED,
                "no token: open the address that the server printed (`rcc-cli serve`), which contains it",
            ),
            Refusal::NoScraperToken => (
                StatusCode::UNAUTHORIZED,
                "no token: give this server a file with `--metrics-token FILE` and the scraper the same file \
                 (`authorization: {credentials_file: FILE}`), or allow every program of this machine with `--metrics-open`",
            ),
            Refusal::WrongScraperToken => (
                StatusCode::FORBIDDEN,
                "wrong token: the scraper needs the one of the file after `--metrics-token`",
            ),
            Refusal::WrongToken => (
                StatusCode::FORBIDDEN,
                "wrong token, perhaps of an earlier server: open the address that this one printed (`rcc-cli serve`)",
            ),
        }
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let (status, words) = self.refusal_text();
        (status, format!("{words}\n")).into_response()
    }
}

/// Answer to an accepted request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Admission {
    /// The handler's answer.
    Handler,
    /// The cookie with the token, and a redirection to the page without it in the address.
    Cookie(String),
}

impl Access {
    /// Creates the rules of a server at 127.0.0.1 and this port.
    #[must_use]
    pub fn new(token: Token, port: u16) -> Access {
        Access {
            token,
            hosts: OwnHosts::loopback(port),
            // Cookies do not know ports: dashboards of several cells must not overwrite each other's.
            cookie: format!("rcc-dashboard-{port}"),
            scraper: None,
            metrics_open: false,
        }
    }

    /// Admits scrapers to `/metrics`: with this token, or without any.
    #[must_use]
    pub fn for_scrapers(mut self, token: Option<Token>, open: bool) -> Access {
        (self.scraper, self.metrics_open) = (token, open);
        self
    }

    /// Returns the address of the page, with the token.
    #[must_use]
    pub fn address(&self) -> String {
        format!(
            "http://{}/?token={}",
            self.hosts.told(),
            self.token.reveal()
        )
    }

    /// Decides about a request.
    ///
    /// # Errors
    /// Returns the reason for refusing it.
    pub fn check(
        &self,
        method: &Method,
        uri: &Uri,
        headers: &HeaderMap,
    ) -> Result<Admission, Refusal> {
        let host = headers.get(header::HOST).map(HeaderValue::as_bytes);
        let host = self.hosts.find(host).ok_or(Refusal::Host)?;
        let reads = matches!(*method, Method::GET | Method::HEAD);
        match headers.get(header::ORIGIN) {
            None if reads => {}
            Some(origin) if is_own_page(host, origin.as_bytes()) => {}
            _ => return Err(Refusal::Origin),
        }
        let is_scrape = uri.path() == "/metrics" && reads;
        if is_scrape && self.metrics_open {
            return Ok(Admission::Handler);
        }
        if let (true, Some(given)) = (is_scrape, headers.get(header::AUTHORIZATION)) {
            let given = given
                .as_bytes()
                .strip_prefix(b"Bearer ")
                .unwrap_or_default();
            let own = self.scraper.as_ref();
            return match own.is_some_and(|token| token.is(given)) {
                true => Ok(Admission::Handler),
                false => Err(Refusal::WrongScraperToken),
            };
        }
        let given = uri.query().and_then(|query| query.strip_prefix("token="));
        if let ("/", true, Some(given)) = (uri.path(), reads, given) {
            return match self.token.is(given.as_bytes()) {
                true => Ok(Admission::Cookie(format!(
                    "{}={given}; Path=/; HttpOnly; SameSite=Strict",
                    self.cookie
                ))),
                false => Err(Refusal::WrongToken),
            };
        }
        let cookies = headers.get_all(header::COOKIE).iter();
        let cookies = cookies.filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|value| value.split(';')).map(str::trim);
        let own = pairs.find_map(|pair| pair.strip_prefix(&self.cookie)?.strip_prefix('='));
        match own {
            None if is_scrape => Err(Refusal::NoScraperToken),
            None => Err(Refusal::NoToken),
            Some(given) if self.token.is(given.as_bytes()) => Ok(Admission::Handler),
            Some(_) => Err(Refusal::WrongToken),
        }
    }
}

/// Checks a request, and adds the headers that restrict pages to every answer.
pub async fn guard(State(access): State<Arc<Access>>, request: Request, next: Next) -> Response {
    let admission = access.check(request.method(), request.uri(), request.headers());
    let mut response = match admission {
        Ok(Admission::Handler) => next.run(request).await,
        Ok(Admission::Cookie(cookie)) => {
            let headers = [
                (header::SET_COOKIE, cookie),
                (header::LOCATION, "/".to_owned()),
            ];
            (StatusCode::SEE_OTHER, headers).into_response()
        }
        Err(refusal) => refusal.into_response(),
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        // The first address contains the token.
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (
            header::HeaderName::from_static("cross-origin-resource-policy"),
            "same-origin",
        ),
        (
            header::HeaderName::from_static("cross-origin-opener-policy"),
            "same-origin",
        ),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if !headers.contains_key(header::CACHE_CONTROL) {
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    const COOKIE: &str = "rcc-dashboard-7426";

    fn access() -> (Access, String) {
        let token = Token::random().expect("random bits");
        let text = token.reveal();
        (Access::new(token, 7426), text)
    }

    fn checked(
        access: &Access,
        method: Method,
        path: &str,
        headers: &[(&'static str, &str)],
    ) -> Result<Admission, Refusal> {
        let headers = headers.iter().map(|(name, value)| {
            let value = HeaderValue::from_str(value).expect("a header");
            (header::HeaderName::from_static(name), value)
        });
        access.check(&method, &path.parse().expect("a path"), &headers.collect())
    }

    #[test]
    fn only_the_token_opens_and_only_as_a_cookie_afterwards() {
        let (access, token) = access();
        let get = |path: &str, cookie: &str| {
            let cookie = ("cookie", cookie);
            checked(
                &access,
                Method::GET,
                path,
                &[("host", "127.0.0.1:7426"), cookie],
            )
        };
        let Ok(Admission::Cookie(cookie)) = get(&format!("/?token={token}"), "") else {
            panic!("the token is refused");
        };
        assert!(
            cookie.ends_with("; Path=/; HttpOnly; SameSite=Strict"),
            "{cookie}"
        );
        let own = format!("a=b; {COOKIE}={token}");
        assert_eq!(get("/api/stream", &own), Ok(Admission::Handler));
        assert_eq!(get("/", ""), Err(Refusal::NoToken));
        assert_eq!(
            get(&format!("/api/stream?token={token}"), ""),
            Err(Refusal::NoToken)
        );
        assert_eq!(get("/?token=", ""), Err(Refusal::WrongToken));
        let wrong = format!("{COOKIE}={}", token.to_uppercase());
        assert_eq!(get("/", &wrong), Err(Refusal::WrongToken));
        assert_eq!(
            get("/", &format!("{COOKIE}0={token}")),
            Err(Refusal::NoToken)
        );
    }

    #[test]
    fn a_foreign_name_for_this_machine_is_refused() {
        let (access, token) = access();
        let cookie = format!("{COOKIE}={token}");
        for host in [
            "evil.example:7426",
            "127.0.0.1",
            "127.0.0.1:80",
            "localhost.evil:7426",
            "",
        ] {
            let headers = [("host", host), ("cookie", &*cookie)];
            let found = checked(&access, Method::GET, "/", &headers);
            assert_eq!(found, Err(Refusal::Host), "{host}");
        }
        let none = checked(&access, Method::GET, "/", &[("cookie", &cookie)]);
        assert_eq!(none, Err(Refusal::Host));
    }

    #[test]
    fn a_scraper_reads_metrics_and_nothing_else() {
        let (access, token) = access();
        let scraper = Token::random().expect("random bits");
        let bearer = format!("Bearer {}", scraper.reveal());
        let host = ("host", "127.0.0.1:7426");
        let get = |access: &Access, path: &str, lines: &[(&'static str, &str)]| {
            let lines = [&[host][..], lines].concat();
            checked(access, Method::GET, path, &lines)
        };
        let own = format!("{COOKIE}={token}");
        assert_eq!(get(&access, "/metrics", &[]), Err(Refusal::NoScraperToken));
        assert_eq!(
            get(&access, "/metrics", &[("cookie", &own)]),
            Ok(Admission::Handler)
        );
        let authorized = [("authorization", &*bearer)];
        assert_eq!(
            get(&access, "/metrics", &authorized),
            Err(Refusal::WrongScraperToken)
        );
        let access = access.for_scrapers(Some(scraper), false);
        assert_eq!(
            get(&access, "/metrics", &authorized),
            Ok(Admission::Handler)
        );
        assert_eq!(get(&access, "/metrics", &[]), Err(Refusal::NoScraperToken));
        for wrong in [
            "Bearer ",
            &format!("{bearer}0"),
            "Basic x",
            &format!("Bearer {token}"),
        ] {
            let lines = [("authorization", wrong)];
            assert_eq!(
                get(&access, "/metrics", &lines),
                Err(Refusal::WrongScraperToken)
            );
        }
        assert_eq!(get(&access, "/", &authorized), Err(Refusal::NoToken));
        assert_eq!(
            get(&access, "/api/stream", &authorized),
            Err(Refusal::NoToken)
        );
        let access = access.for_scrapers(None, true);
        assert_eq!(get(&access, "/metrics", &[]), Ok(Admission::Handler));
        assert_eq!(get(&access, "/api/timing", &[]), Err(Refusal::NoToken));
        // Rebinding and other pages stay outside.
        let foreign = checked(
            &access,
            Method::GET,
            "/metrics",
            &[("host", "evil.example:7426")],
        );
        assert_eq!(foreign, Err(Refusal::Host));
        let page = [("origin", "http://evil.example")];
        assert_eq!(get(&access, "/metrics", &page), Err(Refusal::Origin));
        let post = checked(&access, Method::POST, "/metrics", &[host]);
        assert_eq!(post, Err(Refusal::Origin));
    }

    #[test]
    fn commands_come_from_our_own_page_only() {
        let (access, token) = access();
        let cookie = format!("{COOKIE}={token}");
        let post = |host: &str, origin: Option<&str>| {
            let mut headers = vec![("host", host), ("cookie", &*cookie)];
            headers.extend(origin.map(|origin| ("origin", origin)));
            checked(&access, Method::POST, "/api/nets/1/cancel", &headers)
        };
        let own = "127.0.0.1:7426";
        assert_eq!(
            post(own, Some("http://127.0.0.1:7426")),
            Ok(Admission::Handler)
        );
        for origin in [
            None,
            Some("null"),
            Some("http://evil.example"),
            Some("http://127.0.0.1:80"),
            Some("http://localhost:7426"),
            Some("https://127.0.0.1:7426"),
        ] {
            assert_eq!(post(own, origin), Err(Refusal::Origin), "{origin:?}");
        }
        let reads = [
            ("host", own),
            ("cookie", &*cookie),
            ("origin", "http://evil.example"),
        ];
        let found = checked(&access, Method::GET, "/api/stream", &reads);
        assert_eq!(found, Err(Refusal::Origin));
    }
}
