"""What exports of several formats share: the job, points to begin with, notes of shutters and of what moves."""
