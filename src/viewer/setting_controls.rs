//! The options of [`Settings`] as the command line defines them: name, help, choices. The panel is built from
//! this list, so new fields of the settings appear in it without further code.

use std::any::TypeId;
use std::collections::BTreeMap;

use clap::{Args as _, Command, FromArgMatches as _, builder::ValueParser};

use crate::settings::Settings;

/// Options without a control, since the window renders until it is closed or the request changes.
const HIDDEN: [&str; 2] = ["samples", "budget"];

/// Type of an option's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One of several words.
    Choice,
    /// On or off.
    Switch,
    /// A whole number.
    Count,
    /// A number.
    Number,
    /// Anything else.
    Text,
}

/// A control for one option.
#[derive(Clone, Debug)]
pub struct SettingControl {
    /// Name on the command line, without dashes.
    pub name: String,
    /// Help text.
    pub help: String,
    /// Heading that the option is listed under.
    pub heading: Option<String>,
    /// Type of the value.
    pub kind: Kind,
    /// Permitted words, each with its help text.
    pub choices: Vec<(String, String)>,
    /// Default value; none if it is chosen from the scene.
    pub default: Option<String>,
}

fn command() -> Command {
    Settings::augment_args(Command::new("settings").no_binary_name(true))
}

/// Returns the controls of all options in the order of the command line's help.
#[must_use]
pub fn controls() -> Vec<SettingControl> {
    let mut command = command();
    // Adds the choices that clap derives from types.
    command.build();
    let shown = command.get_arguments().filter(|arg| !HIDDEN.contains(&arg.get_id().as_str()));
    let shown = shown.filter_map(|arg| Some((arg, arg.get_long().filter(|long| !["help", "version"].contains(long))?)));
    let of = |(arg, long): (&clap::Arg, &str)| {
        let possible = arg.get_possible_values();
        let sentence = |value: &clap::builder::PossibleValue| value.get_help().map(ToString::to_string);
        SettingControl {
            name: long.to_owned(),
            help: arg.get_help().map(ToString::to_string).unwrap_or_default(),
            heading: arg.get_help_heading().map(str::to_owned),
            kind: match () {
                () if !arg.get_action().takes_values() => Kind::Switch,
                () if !possible.is_empty() => Kind::Choice,
                () => kind_of(arg.get_value_parser()),
            },
            choices: possible
                .iter()
                .map(|value| (value.get_name().to_owned(), sentence(value).unwrap_or_default()))
                .collect(),
            default: arg.get_default_values().first().map(|value| value.to_string_lossy().into_owned()),
        }
    };
    shown.map(of).collect()
}

fn kind_of(parser: &ValueParser) -> Kind {
    let is = |id: TypeId| parser.type_id() == id;
    match () {
        () if is(TypeId::of::<u32>()) || is(TypeId::of::<u64>()) || is(TypeId::of::<usize>()) => Kind::Count,
        () if is(TypeId::of::<f32>()) || is(TypeId::of::<f64>()) => Kind::Number,
        () => Kind::Text,
    }
}

/// Values that were chosen, by name of the control; all others are at their defaults.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Chosen(pub BTreeMap<String, String>);

impl Chosen {
    /// Returns the values that differ from the defaults in these settings.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        let values = serde_json::to_value(settings).unwrap_or_default();
        let text = |control: &SettingControl| {
            let text = match values.get(control.name.replace('-', "_"))? {
                serde_json::Value::String(text) => text.clone(),
                serde_json::Value::Null => return None,
                // JSON numbers are f64; printing them as f32 keeps 0.05 short.
                serde_json::Value::Number(n) if control.kind == Kind::Number => (n.as_f64()? as f32).to_string(),
                value => value.to_string(),
            };
            (Some(&text) != control.default.as_ref()).then(|| (control.name.clone(), text))
        };
        Self(controls().iter().filter_map(text).collect())
    }

    /// Returns the command-line arguments that choose the same values.
    #[must_use]
    pub fn arguments(&self) -> Vec<String> {
        let words = |(name, value): (&String, &String)| match value.as_str() {
            "true" => vec![format!("--{name}")],
            "false" => Vec::new(),
            _ => vec![format!("--{name}"), value.clone()],
        };
        self.0.iter().flat_map(words).collect()
    }

    /// Parses and checks the settings.
    ///
    /// # Errors
    /// Returns a sentence that says which value is invalid, and why.
    pub fn settings(&self) -> Result<Settings, String> {
        let matches = command().try_get_matches_from(self.arguments()).map_err(|e| first_line(&e.to_string()))?;
        let settings = Settings::from_arg_matches(&matches).map_err(|e| first_line(&e.to_string()))?;
        settings.check().map_err(|e| e.to_string())?;
        Ok(settings)
    }

    /// Removes values that are invalid in combination with the others, such as options of another method.
    /// Returns their names.
    pub fn remove_invalid(&mut self) -> Vec<String> {
        let mut left_out = Vec::new();
        while let Err(cause) = self.settings() {
            // The message names the invalid option first, and may suggest others.
            let place = |name: &&String| cause.find(&format!("--{name}"));
            let named = self.0.keys().filter(|name| place(name).is_some()).min_by_key(place).cloned();
            let Some(name) = named.or_else(|| self.0.keys().next_back().cloned()) else { break };
            self.0.remove(&name);
            left_out.push(name);
        }
        left_out
    }
}

/// Returns the first line of clap's error message, without its prefix.
fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{LightSampling, Technique, UNLIMITED};

    #[test]
    fn every_option_is_a_control_with_its_help() {
        let all = controls();
        assert!(all.len() > 15, "{}", all.len());
        let by_name = |name: &str| all.iter().find(|k| k.name == name).unwrap_or_else(|| panic!("{name}"));
        assert!(all.iter().all(|k| k.help.len() > 10), "each has a sentence");
        let visibility = by_name("visibility");
        assert_eq!((visibility.kind, visibility.default.as_deref()), (Kind::Choice, None));
        assert!(visibility.choices.iter().any(|(name, help)| name == "fast" && help.contains("2012")));
        let interleave = by_name("interleave");
        assert_eq!((interleave.kind, interleave.default.as_deref()), (Kind::Choice, Some("auto")));
        assert_eq!(interleave.choices.len(), 9);
        assert_eq!(by_name("bounces").kind, Kind::Count);
        assert_eq!((by_name("beta").kind, by_name("beta").default.clone()), (Kind::Number, None));
        assert!(!all.iter().any(|k| HIDDEN.contains(&k.name.as_str())));
    }

    #[test]
    fn settings_come_back_as_they_were() {
        let base = Settings::default();
        assert_eq!(Chosen::of(&base), Chosen::default());
        for settings in [
            base.clone(),
            Settings { bounces: 5, beta: Some(0.7), technique: Technique::FAST, paper_clamp: 0.1, ..base.clone() },
            Settings { technique: Technique::PATH, bounces: UNLIMITED, seed: 9, ..base.clone() },
            Settings { interleave: Some(4), unfiltered: true, ..base.clone() },
            Settings::plain(),
            Settings { technique: Technique::PATH, light_sampling: Some(LightSampling::Ris), ..base },
        ] {
            assert_eq!(Chosen::of(&settings).settings(), Ok(settings));
        }
    }

    #[test]
    fn what_is_wrong_is_said_and_what_does_not_fit_is_left_out() {
        let chosen = |pairs: &[(&str, &str)]| Chosen(pairs.iter().map(|(k, v)| ((*k).into(), (*v).into())).collect());
        assert!(chosen(&[("bounces", "many")]).settings().unwrap_err().contains("bounces"));
        assert!(chosen(&[("bounces", "65")]).settings().unwrap_err().contains("0 to 64"));
        let mut foreign = chosen(&[("method", "path"), ("visibility", "fast"), ("bounces", "3")]);
        assert_eq!(foreign.remove_invalid(), ["visibility"]);
        assert_eq!(foreign, chosen(&[("method", "path"), ("bounces", "3")]));
        let mut good = chosen(&[("seed", "3")]);
        assert!(good.remove_invalid().is_empty() && good.settings().is_ok());
    }
}
