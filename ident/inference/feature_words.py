"""What each feature of a chosen effect says, in words for a reader."""

from __future__ import annotations

# Each feature of an effect as a reason for it, and against it.
FEATURE_WORDS = {
    "log_nats": ("the recordings speak for it strongly", "the recordings hardly speak for it"),
    "log_nats_beside": (
        "no smooth function of the joint's state explains as much",
        "a smooth function of the joint's state explains nearly as much",
    ),
    "log_nats_a_row": ("every sample speaks for it", "it shows only over many samples"),
    "log_rows": ("there are many samples", "there are few samples"),
    "gain_in_errors": (
        "it foretells runs that the fit never saw",
        "it hardly foretells runs that the fit never saw",
    ),
    "closed_in_errors": (
        "it lowers the error on every run that the fit never saw",
        "it does not lower the error on all runs that the fit never saw",
    ),
    "size_in_errors": (
        "its size is the same in all parts of the recordings",
        "its size differs between parts of the recordings",
    ),
    "folds_that_gain": (
        "all parts of the recordings agree",
        "parts of the recordings disagree",
    ),
    "share_of_square": ("it explains much of the error", "it explains little of the error"),
    "share_of_gap": ("it closes much of the gap", "it closes little of the gap"),
    "log_size_over_noise": ("it is large beside the noise", "it is small beside the noise"),
    "log_left_over_noise": ("little is left beside it", "much is left beside it"),
    "log_size_over_usual": (
        "its size is one that arms have",
        "its size is not one that arms usually have",
    ),
    "log_share_of_evidence": (
        "most of what the recordings say is said by it",
        "other effects explain far more",
    ),
    "unlike_any_arm": ("arms have such figures", "no arm has such figures"),
    "log_urdf_scale": ("the URDF is about right elsewhere", "the URDF is off elsewhere, too"),
    "visibility": (
        "tuning the model can't imitate it",
        "tuning the model imitates most of it",
    ),
    "inertia_like": ("it is a body, or acts like one", "wrong inertias can imitate it"),
    "event": ("it happens once", "it happens once, so no other run can confirm it"),
    "whole_arm": ("it shows at several joints", "it should show at several joints"),
    "columns": ("its law is simple", "its law has many numbers"),
    "from_every_start": (
        "every start of the search leads to it",
        "another start of the search leads elsewhere",
    ),
    "start_behind": (
        "it stands in the likeliest explanation of all",
        "it stands in an explanation that is not the likeliest of all",
    ),
    "log_friction_spread": (
        "the joint's friction is steady",
        "the joint's friction varies from run to run",
    ),
    "others_here": ("nothing else acts at the joint", "other effects act at the joint, too"),
    "names_a_joint": ("few effects explain this arm", "this arm would need many effects"),
    "smooth_share": (
        "nothing else is left at the joint",
        "something without a name is left at the joint",
    ),
    "log_dispersion": (
        "the model fits the joint down to its noise",
        "the model does not fit the joint down to its noise",
    ),
    "log_shape_left": (
        "nothing of its kind is left beside it",
        "a smooth function still finds torque beside it, so its law may be another one",
    ),
    "share_of_plain_law": (
        "its law says as much without bending",
        "its law has to bend for it, and a bent law follows other causes, too",
    ),
    "share_of_smooth": (
        "beside it a smooth function finds little",
        "beside it a smooth function finds as much as without it",
    ),
    "stands_out": (
        "the joint is off by more than the others",
        "the joint is off by no more than the others",
    ),
    "left_above_others": (
        "beside it the joint is as good as the others",
        "beside it the joint is still off by more than the others",
    ),
    "log_nats_alone": (
        "alone it explains much of what the tuned model leaves",
        "alone it explains little of what the tuned model leaves",
    ),
    "share_alone": (
        "alone it closes much of the error",
        "alone it closes little of the error",
    ),
    "alone_behind": (
        "no effect like it explains more alone",
        "another effect like it explains more alone",
    ),
    "log_nats_in_turn": (
        "beside larger causes it still explains much",
        "beside larger causes it explains little",
    ),
    "share_in_turn": (
        "beside larger causes it closes much of the error that is left",
        "beside larger causes it closes little of the error that is left",
    ),
    "turn_in_errors": (
        "beside larger causes it foretells runs that the fit never saw",
        "beside larger causes it hardly foretells runs that the fit never saw",
    ),
    "rival_behind": ("no other effect explains it", "another effect explains it nearly as well"),
    "place_behind": ("no other joint explains it", "another joint explains it nearly as well"),
    # Of what changed between two sets of recordings:
    "log_size_over_runs": (
        "it is far more than runs of one set differ by",
        "runs of one set differ by as much among themselves",
    ),
    "log_null_ratio": (
        "runs of one set are alike",
        "runs of one set differ by more than their noise",
    ),
    "parts": ("both sets have many runs", "one of the sets has few runs"),
}
