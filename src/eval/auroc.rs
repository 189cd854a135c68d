//! How well a score parts two sets.

/// Area under the receiver operating characteristic: the probability that a score of `positive` is
/// higher than one of `negative`, ties counted half (Mann & Whitney 1947). 1 = always told apart,
/// 0.5 = not at all; `None` where a set has no score but NaN, which is left out.
pub fn auroc(positive: &[f32], negative: &[f32]) -> Option<f64> {
    let known = |scores: &[f32]| -> Vec<f32> {
        let mut known: Vec<f32> = scores.iter().copied().filter(|s| !s.is_nan()).collect();
        known.sort_by(f32::total_cmp);
        known
    };
    let (positive, negative) = (known(positive), known(negative));
    if positive.is_empty() || negative.is_empty() {
        return None;
    }
    let wins: f64 = positive
        .iter()
        .map(|score| {
            let below = negative.partition_point(|other| other < score);
            let upto = negative.partition_point(|other| other <= score);
            0.5 * (below + upto) as f64
        })
        .sum();
    Some(wins / (positive.len() * negative.len()) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_that_never_overlap_are_told_apart_and_exchanged_ones_the_wrong_way() {
        assert_eq!(auroc(&[2.0, 3.0], &[0.0, 1.0]), Some(1.0));
        assert_eq!(auroc(&[0.0, 1.0], &[2.0, 3.0]), Some(0.0));
    }

    #[test]
    fn pairs_are_counted_by_hand() {
        // 3 beats 1, 2 and ties with 3; 1 ties with 1: (2.5 + 0.5) of 6 pairs.
        assert_eq!(auroc(&[3.0, 1.0], &[1.0, 2.0, 3.0]), Some(0.5));
        assert_eq!(auroc(&[1.0, 1.0], &[1.0]), Some(0.5));
        // −0 and +0 are one value.
        assert_eq!(auroc(&[0.0], &[-0.0]), Some(0.5));
    }

    #[test]
    fn a_set_without_scores_tells_nothing() {
        assert_eq!(auroc(&[], &[1.0]), None);
        assert_eq!(auroc(&[1.0], &[f32::NAN]), None);
        assert_eq!(auroc(&[1.0, f32::NAN], &[0.0]), Some(1.0));
    }
}
