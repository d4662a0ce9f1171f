// Small drawings for buttons, 24 x 24, in lines: each a list of shapes. In the script, so that they are
// there at once and need no request.

export const ICONS = {
  sitters: [
    ["circle", { cx: 12, cy: 8.5, r: 4 }],
    ["path", { d: "M4.5 20c1-4.5 4-6 7.5-6s6.5 1.5 7.5 6" }],
  ],
  photos: [
    ["rect", { x: 3.5, y: 6.5, width: 17, height: 12.5, rx: 2 }],
    ["path", { d: "M8.5 6.5 10 4.5h4l1.5 2" }],
    ["circle", { cx: 12, cy: 12.7, r: 3.3 }],
  ],
  making: [
    ["circle", { cx: 12, cy: 12, r: 8.5 }],
    ["path", { d: "M12 7v5l3.2 2.2" }],
  ],
  style: [
    [
      "path",
      {
        d: "M12 3.5c5 0 8.5 3.3 8.5 7.5 0 2.8-2 4.2-4.3 4.2h-1.9c-1.6 0-2 1.3-1.2 2.4.9 1.3.3 2.9-1.4 2.9C7 20.5 3.5 16.8 3.5 12S7.2 3.5 12 3.5z",
      },
    ],
    ["circle", { cx: 8, cy: 11, r: 0.6 }],
    ["circle", { cx: 11, cy: 7.5, r: 0.6 }],
    ["circle", { cx: 15.5, cy: 8.5, r: 0.6 }],
  ],
  portrait: [
    ["rect", { x: 4.5, y: 3, width: 15, height: 18, rx: 1.5 }],
    ["circle", { cx: 12, cy: 9.7, r: 2.7 }],
    ["path", { d: "M7.5 17.5c.6-2.8 2.3-3.9 4.5-3.9s3.9 1.1 4.5 3.9" }],
  ],
  show: [
    ["rect", { x: 3.5, y: 5, width: 17, height: 11.5, rx: 1.5 }],
    ["path", { d: "M8 5v11.5M12 5v11.5M16 5v11.5M9 20h6" }],
  ],
  plus: [["path", { d: "M12 5v14M5 12h14" }]],
  minus: [["path", { d: "M5 12h14" }]],
  close: [["path", { d: "m6 6 12 12M18 6 6 18" }]],
  good: [
    ["circle", { cx: 12, cy: 12, r: 8.5 }],
    ["path", { d: "m8.3 12.3 2.6 2.6 4.9-5.4" }],
  ],
  fair: [
    ["path", { d: "M12 4 3.5 19h17z" }],
    ["path", { d: "M12 10v4M12 16.5v.1" }],
  ],
  bad: [
    ["circle", { cx: 12, cy: 12, r: 8.5 }],
    ["path", { d: "m9 9 6 6M15 9l-6 6" }],
  ],
  upload: [["path", { d: "M12 15.5v-11M7.5 8.5 12 4l4.5 4.5M5 19.5h14" }]],
  download: [["path", { d: "M12 4v11M7.5 11l4.5 4.5 4.5-4.5M5 19.5h14" }]],
  folder: [
    [
      "path",
      {
        d: "M3.5 7A1.5 1.5 0 0 1 5 5.5h4l2 2.5h8A1.5 1.5 0 0 1 20.5 9.5V17a1.5 1.5 0 0 1-1.5 1.5H5A1.5 1.5 0 0 1 3.5 17z",
      },
    ],
  ],
  trash: [["path", { d: "M5 7h14M10 7V4.5h4V7M7 7l.8 12.5h8.4L17 7" }]],
  pause: [["path", { d: "M9 6v12M15 6v12" }]],
  play: [["path", { d: "M8 5.5v13l10-6.5z" }]],
  undo: [
    ["path", { d: "M8.5 5 4 9.5 8.5 14" }],
    ["path", { d: "M4.5 9.5h9a5.5 5.5 0 0 1 0 11H9" }],
  ],
  redo: [
    ["path", { d: "M15.5 5 20 9.5 15.5 14" }],
    ["path", { d: "M19.5 9.5h-9a5.5 5.5 0 0 0 0 11H15" }],
  ],
  mirror: [
    ["path", { d: "M12 3v18", "stroke-dasharray": "2 2.5" }],
    ["path", { d: "M9 7v10H3.5zM15 7v10h5.5z" }],
  ],
  reset: [
    ["path", { d: "M5 5v5h5" }],
    ["path", { d: "M5.5 10a7.5 7.5 0 1 1-.9 5" }],
  ],
  fit: [["path", { d: "M5 9.5V5h4.5M14.5 5H19v4.5M19 14.5V19h-4.5M9.5 19H5v-4.5" }]],
  brush: [
    [
      "path",
      {
        d: "M19.5 4.5 11 13M8.5 13.5c-2.5 0-3 2-3 3.5S4.5 19 3.5 19.3c1.2 1 3.2 1.2 4.7 1.2 2 0 3.3-1.5 3.3-3.5a3 3 0 0 0-3-3.5z",
      },
    ],
  ],
  pencil: [
    ["path", { d: "M4.5 19.5 5.6 15 15.6 5a1.9 1.9 0 0 1 2.7 0l.7.7a1.9 1.9 0 0 1 0 2.7L9 18.4z" }],
    ["path", { d: "m13.8 6.8 3.4 3.4" }],
  ],
  points: [
    ["circle", { cx: 5.5, cy: 8, r: 1.6 }],
    ["circle", { cx: 12, cy: 16, r: 1.6 }],
    ["circle", { cx: 18.5, cy: 8, r: 1.6 }],
    ["path", { d: "m6.6 9.3 4.3 5.4M13.1 14.7l4.3-5.4" }],
  ],
  compare: [
    ["rect", { x: 3.5, y: 5, width: 7.5, height: 14, rx: 1.3 }],
    ["rect", { x: 13, y: 5, width: 7.5, height: 14, rx: 1.3 }],
  ],
  link: [
    [
      "path",
      {
        d: "M10 14a4 4 0 0 0 5.7 0l3-3A4 4 0 0 0 13 5.3l-.9.9M14 10a4 4 0 0 0-5.7 0l-3 3A4 4 0 0 0 11 18.7l.9-.9",
      },
    ],
  ],
  spark: [["path", { d: "M12 4c.6 4.8 2.7 7 8 8-5.3 1-7.4 3.2-8 8-.6-4.8-2.7-7-8-8 5.3-1 7.4-3.2 8-8z" }]],
  eye: [
    ["path", { d: "M3 12c2.2-4 5.3-6 9-6s6.8 2 9 6c-2.2 4-5.3 6-9 6s-6.8-2-9-6z" }],
    ["circle", { cx: 12, cy: 12, r: 2.6 }],
  ],
  paste: [
    ["rect", { x: 5, y: 5, width: 14, height: 15.5, rx: 1.8 }],
    ["path", { d: "M9 5V3.5h6V5M9 11h6M9 15h4" }],
  ],
  info: [
    ["circle", { cx: 12, cy: 12, r: 8.5 }],
    ["path", { d: "M12 11v5M12 7.8v.1" }],
  ],
  external: [
    [
      "path",
      {
        d: "M13.5 4.5h6v6M19.5 4.5 11 13M17 13.5V18a1.5 1.5 0 0 1-1.5 1.5H6A1.5 1.5 0 0 1 4.5 18V8.5A1.5 1.5 0 0 1 6 7h4.5",
      },
    ],
  ],
  left: [["path", { d: "M19 12H5M11 6l-6 6 6 6" }]],
  right: [["path", { d: "M5 12h14M13 6l6 6-6 6" }]],
};
