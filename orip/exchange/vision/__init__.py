"""Models of structure-from-motion programs: Bundler, BAL, VisualSFM's NVM, openMVG and AliceVision; Pix4D's OPF."""
