//! A row of a plan: a pass, its runs per iteration, and the reason.

use std::fmt;

use crate::scene::SceneStats;

/// A pass of an iteration or sample.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PlannedPass {
    /// Name of the pass.
    pub name: &'static str,
    /// Runs per iteration; 0 if skipped.
    pub runs: u32,
    /// Reason for which it runs or is skipped.
    pub reason: String,
}

impl PlannedPass {
    /// Returns the rows of the passes that deform and tessellate meshes, which all plans share.
    #[must_use]
    pub fn of_upload(stats: &SceneStats) -> Vec<Self> {
        let deform = if stats.deforms { "skins and morphs, once per pose after the first" } else { "nothing deforms" };
        let refined = stats.tessellated_triangles > 0;
        let tessellate = if refined { "refines meshes, once per frame, first" } else { "no mesh is tessellated" };
        [("deform", stats.deforms, deform), ("tessellate", refined, tessellate)]
            .map(|(name, runs, reason)| Self { name, runs: u32::from(runs), reason: reason.to_owned() })
            .into()
    }

    /// Writes a table of rows with a heading.
    ///
    /// # Errors
    /// The formatter's error if it cannot write.
    pub fn write_rows(rows: &[Self], f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{:<16} {:>4}  why", "pass", "runs")?;
        for Self { name, runs, reason } in rows {
            let runs = if *runs == 0 { "skip".to_owned() } else { runs.to_string() };
            writeln!(f, "{name:<16} {runs:>4}  {reason}")?;
        }
        Ok(())
    }
}
