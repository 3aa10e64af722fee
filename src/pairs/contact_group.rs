//! What of links touches bodies: one group for every part of a link and kind of body, with a memory and columns of its own.

/// Parts of links that touch things, by the memory they have: one lane per joint (bushes) or per link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactGroup {
    Bushes,
    /// Set of guide ends.
    Guides(usize),
    /// Set of plates on rails: inside front, rear and edge, then outside.
    Rails(usize),
    /// Set of contour ends.
    Contours(usize),
}

/// Kinds of parts.
pub const CONTACT_GROUPS: usize = 17;

impl ContactGroup {
    /// Whether or not a model has them.
    pub const ALL: [ContactGroup; CONTACT_GROUPS] = [
        ContactGroup::Bushes,
        ContactGroup::Guides(0),
        ContactGroup::Guides(1),
        ContactGroup::Guides(2),
        ContactGroup::Guides(3),
        ContactGroup::Rails(0),
        ContactGroup::Rails(1),
        ContactGroup::Rails(2),
        ContactGroup::Rails(3),
        ContactGroup::Rails(4),
        ContactGroup::Rails(5),
        ContactGroup::Contours(0),
        ContactGroup::Contours(1),
        ContactGroup::Contours(2),
        ContactGroup::Contours(3),
        ContactGroup::Contours(4),
        ContactGroup::Contours(5),
    ];

    /// Among all of them.
    pub const fn index(self) -> usize {
        match self {
            ContactGroup::Bushes => 0,
            ContactGroup::Guides(set) => 1 + set,
            ContactGroup::Rails(set) => 5 + set,
            ContactGroup::Contours(set) => 11 + set,
        }
    }

    /// Name of its memory in keyframes.
    pub fn name(self) -> &'static str {
        const NAMES: [&str; CONTACT_GROUPS] = [
            "bushes",
            "guide_inside_front",
            "guide_inside_rear",
            "guide_outside_front",
            "guide_outside_rear",
            "rail_inside_front",
            "rail_inside_rear",
            "rail_inside_edge",
            "rail_outside_front",
            "rail_outside_rear",
            "rail_outside_edge",
            "rim_front",
            "rim_rear",
            "inner_front",
            "inner_rear",
            "face_front",
            "face_rear",
        ];
        NAMES[self.index()]
    }

    /// Whether it slides on guides only; bushes and contours on sprockets do not.
    pub fn is_on_guides(self) -> bool {
        // The last two sets of contours are those of the guides' faces.
        matches!(self, ContactGroup::Guides(_) | ContactGroup::Rails(_) | ContactGroup::Contours(4..))
    }

    /// Whether it is one of the two ends of a set of links' own contours.
    pub fn is_set(self, set: usize) -> bool {
        matches!(self, ContactGroup::Contours(own) if own / 2 == set)
    }
}
