//! Refuses requests that the interface does not have: an unknown address, a method that an address does not take, and
//! query parameters that it does not read. The OpenAPI document is the table of all three. Run by the one thread that
//! serves connections.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{Method, Uri, header};
use axum::response::{IntoResponse, Response};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_config::diagnostic::closest;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::OPEN_API;
use crate::server::error::ErrorResponse;

/// Maximum number of characters of a client's text that an error quotes.
const QUOTED_MAX: usize = 80;

/// Methods of a path item (OpenAPI 3.1, section 4.8.9.1).
pub(super) const METHODS: [&str; 7] = ["get", "put", "post", "delete", "options", "head", "patch"];

/// Names of the query parameters that each method of an address reads.
type Methods = BTreeMap<String, Vec<String>>;

/// The addresses of the interface, with variable parts as `{name}`.
static ADDRESSES: LazyLock<BTreeMap<String, Methods>> =
    LazyLock::new(|| addresses(&serde_json::from_str(OPEN_API).unwrap_or_default()));

/// Returns path, method and operation of each operation of a document.
pub(super) fn operations(document: &Value) -> impl Iterator<Item = (&str, &str, &Value)> {
    let paths = document["paths"].as_object().into_iter().flatten();
    paths.flat_map(|(path, item)| {
        let methods = METHODS.into_iter();
        methods.filter_map(move |method| Some((path.as_str(), method, item.get(method)?)))
    })
}

fn addresses(document: &Value) -> BTreeMap<String, Methods> {
    let mut all: BTreeMap<String, Methods> = BTreeMap::new();
    for (path, method, operation) in operations(document) {
        let parameters = operation["parameters"].as_array().into_iter().flatten();
        let names = parameters.filter(|parameter| parameter["in"] == "query");
        let names = names.filter_map(|parameter| parameter["name"].as_str().map(str::to_owned));
        let methods = all.entry(path.to_owned()).or_default();
        methods.insert(method.to_uppercase(), names.collect());
    }
    all
}

/// HEAD is answered wherever GET is.
fn same_as(method: &Method) -> &str {
    match method.as_str() {
        "HEAD" => "GET",
        other => other,
    }
}

/// Checks that a matched route takes this method.
///
/// # Errors
/// Returns the answer 405 with the header `allow` (RFC 9110, section 15.5.6). Boxed neither here nor there: it is sent at
/// once.
#[allow(clippy::result_large_err)]
pub(super) fn check_method(method: &Method, route: &str) -> Result<(), Response> {
    let Some(methods) = ADDRESSES.get(route) else {
        return Ok(());
    };
    if methods.contains_key(same_as(method)) {
        return Ok(());
    }
    let mut allowed: Vec<&str> = methods.keys().map(String::as_str).collect();
    let error = ApiError::new(
        codes::NO_METHOD,
        format!("`{route}` does not take {}", quoted(method.as_str())),
        format!("it takes {}", allowed.join(" and ")),
    );
    if methods.contains_key("GET") {
        allowed.push("HEAD");
    }
    let allow = [(header::ALLOW, allowed.join(", "))];
    Err((allow, ErrorResponse(error)).into_response())
}

/// Checks the query of a request: only known parameters, each at most once.
///
/// # Errors
/// Returns [`codes::BAD_REQUEST`] and the parameter that is probably meant.
pub(super) fn check_query(method: &Method, route: &str, uri: &Uri) -> Result<(), ApiError> {
    let given = axum::extract::Query::<Vec<(String, String)>>::try_from_uri(uri);
    // Every query is a list of names and values; only their types can be wrong.
    let given = given.map_or_else(|_| Vec::new(), |query| query.0);
    let known = ADDRESSES
        .get(route)
        .and_then(|methods| methods.get(same_as(method)));
    let known = known.map_or(&[][..], Vec::as_slice);
    for (at, (name, _)) in given.iter().enumerate() {
        let bad = |what: &str, help: String| {
            let message = format!("{what}: `{}`", quoted(name));
            Err(ApiError::new(codes::BAD_REQUEST, message, help))
        };
        if !known.contains(name) {
            return bad("unknown query parameter", meant(name, known));
        }
        if given.iter().take(at).any(|(before, _)| before == name) {
            return bad(
                "query parameter given twice",
                "give it once; several patterns are separated by commas".to_owned(),
            );
        }
    }
    Ok(())
}

fn meant(name: &str, known: &[String]) -> String {
    match closest(name, known.iter().map(String::as_str)) {
        Some(near) => format!("did you mean `{near}`?"),
        None if known.is_empty() => "this request takes no query parameters".to_owned(),
        None => format!("this request takes `{}`", known.join("`, `")),
    }
}

/// Returns the error for the faulty query of a CANCEL or ABORT that was carried out.
pub(super) fn after_stop(error: ApiError) -> ApiError {
    ApiError {
        message: format!(
            "the net was stopped, but the request has an {}",
            error.message
        ),
        ..error
    }
}

/// The answer to an address that does not exist.
pub(super) async fn no_route(uri: Uri) -> ErrorResponse {
    let path = uri.path();
    let help = match near_address(path) {
        Some(near) => format!("did you mean `{near}`? `GET /openapi.json` lists all addresses"),
        None => "`GET /openapi.json` lists all addresses".to_owned(),
    };
    let message = format!("address `{}` does not exist", quoted(path));
    ErrorResponse(ApiError::new(codes::NO_ROUTE, message, help))
}

/// Returns the most similar address with as many parts; variable parts are similar to anything.
fn near_address(path: &str) -> Option<String> {
    let given: Vec<&str> = path.split('/').collect();
    let candidates = ADDRESSES.keys().filter_map(|address| {
        let parts: Vec<&str> = address.split('/').collect();
        let filled =
            parts.iter().zip(&given).map(
                |(part, given)| {
                    if part.starts_with('{') { *given } else { *part }
                },
            );
        let filled: Vec<&str> = filled.collect();
        (parts.len() == given.len()).then(|| filled.join("/"))
    });
    let candidates: Vec<String> = candidates.collect();
    // The root is as near to each short address as to any other.
    let near = closest(path, candidates.iter().map(String::as_str)).filter(|_| path.len() > 1);
    near.map(quoted)
}

fn quoted(text: &str) -> String {
    text.chars().take(QUOTED_MAX).collect()
}

/// The query of a request; a value of the wrong type is refused with its name.
pub(super) struct Query<T>(pub T);

impl<T: DeserializeOwned, S: Sync> FromRequestParts<S> for Query<T> {
    type Rejection = ErrorResponse;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Query<T>, ErrorResponse> {
        let read = axum::extract::Query::<T>::try_from_uri(&parts.uri);
        read.map(|query| Query(query.0)).map_err(|refused| {
            let text = refused.body_text();
            let cause = text
                .rsplit_once("string: ")
                .map_or(&*text, |(_, cause)| cause);
            ErrorResponse(ApiError::new(
                codes::BAD_REQUEST,
                format!("invalid query parameter: {cause}"),
                "see `GET /openapi.json` for its type",
            ))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(method: &str, address: &str, uri: &str) -> Option<(String, String)> {
        let method: Method = method.parse().expect("a method");
        let uri: Uri = uri.parse().expect("an address");
        let error = check_query(&method, address, &uri).err()?;
        assert_eq!(error.code, codes::BAD_REQUEST);
        Some((error.message, error.help))
    }

    #[test]
    fn every_operation_refuses_a_parameter_that_it_does_not_read() {
        for (address, methods) in ADDRESSES.iter() {
            for (method, known) in methods {
                let refused = refusal(method, address, "/x?no_such=1");
                let (message, _) = refused.unwrap_or_else(|| panic!("{method} {address}"));
                assert!(message.contains("`no_such`"), "{message}");
                for name in known {
                    let uri = format!("/x?{name}=1");
                    assert_eq!(refusal(method, address, &uri), None, "{method} {address}");
                    let typo = format!("/x?{}=1", &name[1..]);
                    let help = refusal(method, address, &typo).expect("a typo").1;
                    assert_eq!(help, format!("did you mean `{name}`?"));
                }
            }
        }
        let values = "/commands/{name}/values";
        assert_eq!(refusal("HEAD", values, "/x?ports=a"), None);
        assert_eq!(refusal("GET", values, "/x?p%6Frts=a"), None);
        let twice = refusal("GET", values, "/x?ports=a&ports=b").expect("twice");
        assert_eq!(twice.0, "query parameter given twice: `ports`");
        let none = refusal("GET", "/status", "/x?a").expect("none");
        assert_eq!(none.1, "this request takes no query parameters");
    }

    #[test]
    fn every_address_says_which_methods_it_takes() {
        for (address, methods) in ADDRESSES.iter() {
            for method in ["GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"] {
                let method: Method = method.parse().expect("a method");
                let answer = check_method(&method, address);
                let taken = methods.contains_key(same_as(&method));
                assert_eq!(answer.is_ok(), taken, "{method} {address}");
                let Err(answer) = answer else { continue };
                assert_eq!(answer.status(), 405);
                let allow = answer.headers()[header::ALLOW].to_str().expect("ASCII");
                let all: Vec<&str> = methods.keys().map(String::as_str).collect();
                assert!(allow.starts_with(&all.join(", ")), "{address}: {allow}");
            }
        }
    }

    #[test]
    fn a_misspelt_address_has_a_near_one() {
        for (path, near) in [
            ("/comands", Some("/commands")),
            ("/commands/line/valeus", Some("/commands/line/values")),
            ("/xyzzy", None),
            ("/", None),
        ] {
            assert_eq!(near_address(path).as_deref(), near, "{path}");
        }
    }
}
