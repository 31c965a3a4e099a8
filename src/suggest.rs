//! "Did you mean": the known word that an unknown one was probably meant to be.

/// Most known words of about the right length that are compared: a search must stay cheap on models of any size.
const MOST_COMPARED: usize = 10_000;
/// A longer word is cut here: it is near to nothing, and a comparison costs the product of the lengths.
const LONGEST: usize = 64;

/// The known word nearest to `unknown`, if one is near: a third of its letters, at most three, may be inserted, deleted,
/// replaced or swapped with a neighbour. Upper and lower case count as alike. Of words that are equally near, the first.
///
/// ```
/// assert_eq!(lanesim::suggest::nearest("frction", ["mass", "friction"]), Some("friction"));
/// assert_eq!(lanesim::suggest::nearest("colour", ["mass", "friction"]), None);
/// ```
pub fn nearest<'a>(unknown: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let word = letters(unknown);
    let limit = (word.len() / 3).clamp(1, 3);
    known
        .into_iter()
        // A character has at most four bytes.
        .filter(|known| !known.is_empty() && known.len() <= 4 * (word.len() + limit))
        .map(|known| (letters(known), known))
        .filter(|(letters, _)| letters.len().abs_diff(word.len()) <= limit)
        .take(MOST_COMPARED)
        .map(|(letters, known)| (distance(&word, &letters), known))
        // A word of which nothing is left is not near.
        .filter(|&(distance, _)| distance <= limit && distance < word.len())
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, known)| known)
}

/// `did you mean "x"?`, or nothing if no known word is near: the remedy of a message.
pub fn did_you_mean<'a>(unknown: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    nearest(unknown, known).map_or(String::new(), |near| format!("did you mean \"{near}\"?"))
}

/// As [`did_you_mean`]; if no word is near and there are few, lists all of them.
pub fn or_list<'a>(unknown: &str, known: impl IntoIterator<Item = &'a str> + Clone) -> String {
    const MOST_LISTED: usize = 40;
    let near = did_you_mean(unknown, known.clone());
    let list: Vec<&str> = known.into_iter().take(MOST_LISTED + 1).collect();
    if !near.is_empty() || list.is_empty() || list.len() > MOST_LISTED {
        return near;
    }
    format!("valid: {}", list.join(", "))
}

fn letters(word: &str) -> Vec<char> {
    word.chars().take(LONGEST).map(|c| c.to_ascii_lowercase()).collect()
}

/// Number of characters to insert, delete, replace or swap with a neighbour to turn one word into the other.
fn distance(a: &[char], b: &[char]) -> usize {
    let mut older = vec![0; b.len() + 1];
    let mut previous: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut current = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let replace = previous[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            current[j] = replace.min(previous[j] + 1).min(current[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                current[j] = current[j].min(older[j - 2] + 1);
            }
        }
        older = std::mem::replace(&mut previous, current);
    }
    previous[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_words() {
        let known = ["friction", "mass", "Euler", "left_knee", "right_knee", "pos"];
        let near = |word: &str| nearest(word, known);
        assert_eq!(near("frction"), Some("friction"));
        assert_eq!(near("firction"), Some("friction"));
        assert_eq!(near("mas"), Some("mass"));
        assert_eq!(near("EULER"), Some("Euler"));
        assert_eq!(near("left_kne"), Some("left_knee"));
        assert_eq!(near("pso"), Some("pos"));
    }

    #[test]
    fn far_words() {
        for word in ["", "x", "colour", "shoulder", "é", &"friction".repeat(1000)] {
            assert_eq!(nearest(word, ["friction", "mass", "", "y"]), None, "{word}");
        }
        assert_eq!(nearest("a", std::iter::empty()), None);
    }

    #[test]
    fn sentences() {
        assert_eq!(did_you_mean("frction", ["friction"]), "did you mean \"friction\"?");
        assert_eq!(did_you_mean("colour", ["friction"]), "");
        assert_eq!(or_list("colour", ["friction", "mass"]), "valid: friction, mass");
        assert_eq!(or_list("mas", ["friction", "mass"]), "did you mean \"mass\"?");
        assert_eq!(or_list("colour", ["friction"; 41]), "");
    }

    /// A search through many names stays cheap: it ends after a number of comparisons.
    #[test]
    fn many_words() {
        let behind = |others: usize| {
            let names = (0..others).map(|_| "shoulder").chain(["aaaabbbb"]).collect::<Vec<_>>();
            nearest("aaaabbbc", names)
        };
        assert_eq!(behind(MOST_COMPARED - 1), Some("aaaabbbb"));
        assert_eq!(behind(MOST_COMPARED), None);
    }
}
