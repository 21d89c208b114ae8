//! "Did you mean": the known name nearest to an unknown one.

/// `; did you mean "x"?` if one of the names is near, else nothing.
pub(crate) fn did_you_mean(found: &str, known: &[&str]) -> String {
    nearest(found, known).map(|name| format!("; did you mean \"{name}\"?")).unwrap_or_default()
}

fn nearest<'a>(found: &str, known: &[&'a str]) -> Option<&'a str> {
    // Nothing sensible is near a very long word, and the distance takes quadratic time.
    if found.len() > 64 {
        return None;
    }
    let found = found.to_lowercase();
    let tolerance = 1 + found.chars().count() / 4;
    known
        .iter()
        .map(|name| (distance(&found, &name.to_lowercase()), *name))
        .filter(|(distance, _)| *distance <= tolerance)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

/// Edits (insert, delete, replace, swap neighbours) that lead from one word to the other: optimal string alignment.
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut table = vec![vec![0; b.len() + 1]; a.len() + 1];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            if i == 0 || j == 0 {
                table[i][j] = i + j;
                continue;
            }
            let replace = table[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            table[i][j] = replace.min(table[i - 1][j] + 1).min(table[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                table[i][j] = table[i][j].min(table[i - 2][j - 2] + 1);
            }
        }
    }
    table[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_near_names_only() {
        assert_eq!(nearest("shpere", &["sphere", "disk"]), Some("sphere"));
        assert_eq!(nearest("Radius", &["radius", "zmin"]), Some("radius"));
        assert_eq!(nearest("cube", &["sphere", "disk"]), None);
    }
}
