#pragma once

#include <vector>

#include "videogrammetry/matching/candidates.h"

namespace videogrammetry {

/// Sets `probability` of every candidate: that it belongs to the true set of
/// matches, no target of which is used twice.
///
/// With the scores s_k as log odds against "its targets are none of these", a
/// compatible set S has the probability exp(sum_{k in S} s_k) / Z. Candidates
/// that share targets, directly or through others, form groups. In small groups
/// all compatible sets are summed; in others belief propagation on the graph of
/// candidates and targets takes its place: with the messages
///   log m_{k->t} = s_k + sum_{u in k, u != t} log n_{u->k},
///   n_{t->k} = 1 / (1 + sum_{l at t, l != k} m_{l->t})
/// the odds of k are exp(s_k) prod n_{t->k}. It is exact on trees and, between
/// two cameras, converges always (Huang and Jebara 2009; Williams and Lau,
/// Approximate evaluation of marginal association probabilities with belief
/// propagation, IEEE TAES 50, 2014).
///
/// @param num_targets  targets of each camera.
/// @param exact_limit  sets that are summed at most in a group; 0: always
///     belief propagation.
/// @param max_iterations  of the propagation, for each group of its own. Loops may not have
///     settled by then: of real particles the mean log odds of a match were within 0.006
///     of those after 100.
void SetProbabilities(const std::vector<std::size_t>& num_targets,
                      std::vector<Candidate>* candidates, int exact_limit = 500,
                      int max_iterations = 30);

/// Probability that all targets of each candidate belong to one point: its own
/// and those of the candidates that contain it.
std::vector<double> ProbabilitiesOfOnePoint(const std::vector<std::size_t>& num_targets,
                                            const std::vector<Candidate>& candidates);

}  // namespace videogrammetry
