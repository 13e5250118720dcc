#include "mortar/box_tree.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

namespace latin::mortar {

namespace {

constexpr Index leaf = 8;  ///< Boxes that are looked at one by one.

}  // namespace

BoxTree::BoxTree(std::vector<Box> boxes) : boxes_(std::move(boxes)), members_(boxes_.size()) {
  std::iota(members_.begin(), members_.end(), Index{0});
  if (!boxes_.empty()) {
    build(0, static_cast<Index>(boxes_.size()));
  }
}

void BoxTree::build(Index begin, Index end) {
  Box box;
  Box centres;
  for (Index k = begin; k < end; ++k) {
    const Box& one = boxes_[members_[k]];
    box.extend(one);
    centres.extend(one.center());
  }
  const auto number = static_cast<Index>(nodes_.size());
  nodes_.push_back({box, begin, end, 0});
  if (end - begin <= leaf) {
    return;
  }
  Index axis = 0;
  centres.sizes().maxCoeff(&axis);
  const Index middle = (begin + end) / 2;
  std::nth_element(
      members_.begin() + begin, members_.begin() + middle, members_.begin() + end,
      [&](Index a, Index b) { return boxes_[a].center()[axis] < boxes_[b].center()[axis]; });
  build(begin, middle);
  nodes_[number].second = static_cast<Index>(nodes_.size());
  build(middle, end);
}

void BoxTree::touching(const Box& box, std::vector<Index>& found) const {
  found.clear();
  std::vector<Index> open;
  if (!nodes_.empty()) {
    open.push_back(0);
  }
  while (!open.empty()) {
    const Node& node = nodes_[open.back()];
    const Index number = open.back();
    open.pop_back();
    if (!node.box.intersects(box)) {
      continue;
    }
    if (node.second > 0) {
      open.push_back(number + 1);
      open.push_back(node.second);
      continue;
    }
    for (Index k = node.begin; k < node.end; ++k) {
      if (boxes_[members_[k]].intersects(box)) {
        found.push_back(members_[k]);
      }
    }
  }
  std::sort(found.begin(), found.end());
}

}  // namespace latin::mortar
