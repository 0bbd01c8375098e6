//! Words of PETSc's options on the command line and in the environment.

use crate::error::{Error, Result};

/// Name of the environment variable that holds PETSc options.
pub const VARIABLE: &str = "PETSC_OPTIONS";

/// Extracts the option `-skip_petscrc` and its value from a text of options.
pub(super) fn skip_petscrc(text: &str) -> Vec<String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let Some(place) = words.iter().rposition(|word| word.trim_start_matches('-') == "skip_petscrc") else {
        return Vec::new();
    };
    let value = words.get(place + 1).filter(|word| !is_name(word));
    [Some(&words[place]), value].into_iter().flatten().map(ToString::to_string).collect()
}

/// Checks that arguments are options with at most one value each, none of them NaN.
///
/// PETSc itself ignores such words silently.
///
/// # Errors
/// Returns [`Error::Usage`] naming the first word that is neither an option nor its value, or the
/// option whose value is NaN.
pub fn validate(arguments: &[String]) -> Result<()> {
    let mut option = None;
    for word in arguments {
        if is_name(word) {
            option = Some(word);
            continue;
        }
        let Some(option) = option.take() else {
            return Err(Error::Usage(format!(
                "`{word}` after `--` is neither a PETSc option (-name) nor the value of one"
            )));
        };
        refuse_nan(option, word)?;
    }
    Ok(())
}

/// Returns an error for a value that is not a number.
pub(super) fn refuse_nan(option: &str, value: &str) -> Result<()> {
    if value.trim_start_matches(['-', '+']).eq_ignore_ascii_case("nan") {
        return Err(Error::Usage(format!("the PETSc option `{option} {value}`: the value is not a number")));
    }
    Ok(())
}

/// Returns whether PETSc takes a word for an option name: a letter after one dash or two.
///
/// `-1e-3` is a value.
pub(super) fn is_name(word: &str) -> bool {
    let name = word.strip_prefix("--").or_else(|| word.strip_prefix('-')).unwrap_or_default();
    let special = ["inf", "infinity", "nan"].iter().any(|value| name.eq_ignore_ascii_case(value));
    name.starts_with(|c: char| c.is_ascii_alphabetic()) && !special
}
