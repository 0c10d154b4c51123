"""A plan of fringes for a projector: proposed for a number of frames, drawn, and written."""

import fringeworks as fw

# Your own: columns and rows of your projector, and the noise of your camera in counts.
proposals = fw.propose(1920, 1080, 12, noise=2.0)
for proposal in proposals:
    print(f"{proposal.kind}: σ {proposal.sigma_px:.3f} px, {proposal.summary}")
plan = proposals[0].plan
fw.files.write_plan("plan.toml", plan)
fw.files.write_patterns("patterns", plan)  # the pictures to project, in their order

figure = plan.plot()
fw.save_figure(figure, "plan.png")
