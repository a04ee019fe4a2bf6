//! Wall time as text. Runs on any thread that is not real-time.

use std::time::Duration;

/// Returns the current wall time, UTC with microseconds: `2026-11-21T16:02:03.123456Z`. The texts sort like the times.
/// A clock before 1970 counts as the beginning of 1970.
#[must_use]
pub fn wall_time() -> String {
    wall_time_before(Duration::ZERO)
}

/// Returns the wall time `ago` before now.
#[must_use]
pub fn wall_time_before(ago: Duration) -> String {
    format(rcc_os::wall::since_epoch().saturating_sub(ago))
}

fn format(since_epoch: Duration) -> String {
    let seconds = since_epoch.as_secs();
    let (year, month, day) = civil(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    let micros = since_epoch.subsec_micros();
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{micros:06}Z")
}

/// Reads a wall time as written by [`wall_time`]: the time since 1970; `None` if it is not one.
#[must_use]
pub fn since_epoch_of(text: &str) -> Option<Duration> {
    let (date, time) = text.strip_suffix('Z')?.split_once('T')?;
    let number = |part: &str| part.parse::<u64>().ok();
    let mut date = date.splitn(3, '-').map(number);
    let (year, month, day) = (date.next()??, date.next()??, date.next()??);
    let mut time = time.splitn(3, ':');
    let (hour, minute) = (number(time.next()?)?, number(time.next()?)?);
    let (second, fraction) = time.next()?.split_once('.')?;
    let nanos = number(format!("{fraction:0<9}").get(..9)?)?;
    if !(1970..=9999).contains(&year) || hour > 23 || minute > 59 {
        return None;
    }
    // Few steps: the inverse of `civil`, by search over the days of that year and month.
    let first = (year - 1970) * 365 + (year - 1969) / 4 - (year - 1901) / 100 + (year - 1601) / 400;
    let day = (first..first + 366).find(|number| civil(*number) == (year, month, day))?;
    let seconds = day * 86_400 + hour * 3600 + minute * 60 + number(second)?;
    Some(Duration::new(seconds, u32::try_from(nanos).ok()?))
}

/// Converts days since 1970-01-01 to year, month and day (Gregorian calendar). Years begin in March, so that the leap
/// day is the last day of its year; 400 years are one era.
fn civil(day: u64) -> (u64, u64, u64) {
    // Days from 0000-03-01 to 1970-01-01; below, days in 400, 100, 4 years and one year.
    let day = day + 719_468;
    let era = day / 146_097;
    let of_era = day % 146_097;
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    // Months from March have 31 30 31 30 31 days, repeatedly.
    let month = (5 * of_year + 2) / 153;
    let day_of_month = of_year - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 {
        (month + 3, 0)
    } else {
        (month - 9, 1)
    };
    (era * 400 + year_of_era + next, month, day_of_month)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_read_as_it_was_written() {
        for seconds in [0, 951_782_399, 951_782_400, 1_709_251_199, 4_107_542_400] {
            let time = Duration::new(seconds, 123_456_000);
            assert_eq!(since_epoch_of(&format(time)), Some(time));
        }
        for day in 0..60_000 {
            let time = Duration::from_secs(day * 86_400);
            assert_eq!(since_epoch_of(&format(time)), Some(time));
        }
        let milliseconds = since_epoch_of("1970-01-01T00:00:01.5Z");
        assert_eq!(milliseconds, Some(Duration::from_millis(1500)));
        for wrong in ["", "now", "2026-13-01T00:00:00.0Z", "2026-01-01T00:00:00.0"] {
            assert_eq!(since_epoch_of(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn days_of_known_dates() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00.000000Z"),
            (951_782_399, "2000-02-28T23:59:59.000000Z"),
            (951_782_400, "2000-02-29T00:00:00.000000Z"),
            (1_709_251_199, "2024-02-29T23:59:59.000000Z"),
            (1_735_689_599, "2024-12-31T23:59:59.000000Z"),
            (4_107_542_400, "2100-03-01T00:00:00.000000Z"),
        ] {
            assert_eq!(format(Duration::from_secs(seconds)), text);
        }
    }

    #[test]
    fn texts_sort_as_their_times() {
        let earlier = wall_time_before(Duration::from_secs(1));
        assert!(earlier < wall_time());
    }
}
